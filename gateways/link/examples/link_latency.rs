//! Latency of a topic's message from `put` to its reader, over the link (Zenoh, TCP on loopback, JSON) and over iceoryx2
//! (publish/subscribe, as the record stream uses it), in one run on one host: `link_latency [MESSAGES]`. The main thread
//! sends every 2 ms; Zenoh calls its reader, that of iceoryx2 polls without a pause.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable};
use rcc_ipc::{Cell, Session};
use rcc_link::keys::CellKeys;
use rcc_link::message::{TopicMessage, VERSION};
use rcc_link::session;
use rcc_protocol::Role;
use rcc_testing::quantile;
use zenoh::Wait;

const PERIOD: Duration = Duration::from_millis(2);
/// Longest wait for one message.
const MESSAGE_MAX: Duration = Duration::from_secs(10);

/// A topic's value in shared memory.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Record {
    sequence: u64,
    age_ns: u64,
    value: f64,
}

type Arrivals = Receiver<(u64, Instant)>;

/// Sends by `send` and waits for each message; returns the latencies, sorted.
fn measure(messages: u64, arrivals: &Arrivals, mut send: impl FnMut(u64)) -> Vec<Duration> {
    let mut latencies = Vec::new();
    let mut next = Instant::now();
    for sequence in 1..=messages {
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        next += PERIOD;
        let sent = Instant::now();
        send(sequence);
        while let Ok((number, arrived)) = arrivals.recv_timeout(MESSAGE_MAX) {
            if number == sequence {
                latencies.push(arrived.saturating_duration_since(sent));
                break;
            }
        }
    }
    latencies.sort_unstable();
    latencies
}

fn row(name: &str, messages: u64, latencies: &[Duration]) {
    let at =
        |share| quantile(latencies, share).map_or(f64::NAN, |latency| latency.as_secs_f64() * 1e6);
    println!(
        "{name:<10} {:>6} of {messages} messages  p50 {:>8.1} µs  p99 {:>8.1} µs  max {:>8.1} µs",
        latencies.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
}

fn over_zenoh(messages: u64) -> Result<Vec<Duration>, Box<dyn std::error::Error>> {
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp)?;
    let endpoint = vec![format!("tcp/127.0.0.1:{port}")];
    let key = CellKeys::new("lab", "a")
        .topic("belt/position")
        .ok_or("a key")?;
    let sender = session::open(&endpoint, &[], None)?;
    let reader = session::open(&[], &endpoint, None)?;
    let (told, arrivals) = channel();
    let subscriber = reader.declare_subscriber(&key).callback(move |sample| {
        if let Ok(message) = TopicMessage::read(&sample.payload().to_bytes()) {
            // The receiver ends with the run.
            let _ = told.send((message.sequence, Instant::now()));
        }
    });
    let subscriber = subscriber.wait().map_err(|error| error.to_string())?;
    let origin = Instant::now();
    let mut send = |sequence: u64| {
        let message = TopicMessage {
            version: VERSION,
            sender: "0".repeat(16),
            sequence,
            sent_ns: origin.elapsed().as_nanos() as u64,
            age_ns: 1_000_000,
            ty: "Real".to_owned(),
            unit: Some("m".to_owned()),
            value: 0.25.into(),
        };
        let bytes = message.bytes().unwrap_or_default();
        let put = sender.put(&key, bytes).attachment(&key).express(true);
        if let Err(error) = put.wait() {
            eprintln!("{error}");
        }
    };
    // Until the subscription is known to the sender.
    while arrivals.try_recv().is_err() {
        send(0);
        std::thread::sleep(PERIOD);
    }
    let latencies = measure(messages, &arrivals, &mut send);
    subscriber
        .undeclare()
        .wait()
        .map_err(|error| error.to_string())?;
    for session in [reader, sender] {
        session.close().wait().map_err(|error| error.to_string())?;
    }
    Ok(latencies)
}

fn over_iceoryx2(messages: u64) -> Result<Vec<Duration>, Box<dyn std::error::Error>> {
    let folder = rcc_testing::folder();
    let cell = Cell::at("latency", folder.path())?;
    let session = Session::join(&cell, Role::Executor, "exec")?;
    let mut publisher = session.publisher::<Record>("values")?;
    let mut reader = session.subscribe::<Record>(publisher.service())?;
    let (told, arrivals) = channel();
    let ends = AtomicBool::new(false);
    let latencies = std::thread::scope(|scope| {
        scope.spawn(|| {
            // Relaxed: nothing else depends on it.
            while !ends.load(Ordering::Relaxed) {
                for record in reader.next_batch().ok().flatten().unwrap_or_default() {
                    let _ = told.send((record.sequence, Instant::now()));
                }
                std::hint::spin_loop();
            }
        });
        let latencies = measure(messages, &arrivals, |sequence| {
            let record = Record {
                sequence,
                age_ns: 1_000_000,
                value: 0.25,
            };
            if let Err(error) = publisher.publish(&[record]) {
                eprintln!("{error}");
            }
        });
        ends.store(true, Ordering::Relaxed);
        latencies
    });
    drop((publisher, reader, session));
    // The files of a cell in shared memory outlive its processes; elsewhere a janitor removes them.
    rcc_ipc::clean::remove_cell(&cell)?;
    Ok(latencies)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let messages = std::env::args()
        .nth(1)
        .map_or(Ok(5000), |text| text.parse())?;
    row("iceoryx2", messages, &over_iceoryx2(messages)?);
    row("link", messages, &over_zenoh(messages)?);
    Ok(())
}
