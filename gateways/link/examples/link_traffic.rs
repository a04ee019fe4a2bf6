//! Key space and traffic of a site: `link_traffic [CELLS] [RATE_HZ]`. Makes the keys and messages of every cell with the
//! encoders of `rcc-link`, finds who gets which by Zenoh's own matching of key expressions, and adds up messages and bytes on
//! each kind of connection. What Zenoh adds to the payload is measured in the same run, through a relay on loopback.
//! Single-threaded, apart from the measurement.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use rcc_link::keys::{CellKeys, Operation};
use rcc_link::message::{TopicMessage, VERSION};
use rcc_link::overview::{CellOverview, OverviewEvent};
use rcc_link::session;
use zenoh::Wait;
use zenoh::key_expr::KeyExpr;

type Failure = Box<dyn std::error::Error>;

/// Cells at one router, as a hall has it.
const CELLS_OF_ROUTER: usize = 50;
/// Topics that each cell's nets publish.
const TOPICS: usize = 8;
/// Topics that each cell takes from the next one of its hall.
const TAKEN: usize = 4;
/// One cell in so many takes a topic from the next hall, too.
const FAR_EVERY: usize = 10;
/// `rcc-link top` at the routers of the first halls.
const SCREENS: usize = 3;
/// Events, and states of nets, of a cell per second.
const EVENTS_HZ: f64 = 0.2;
/// Ethernet, IPv4 and TCP headers of a packet; each message is sent in one of its own, bytes.
const PACKET: usize = 14 + 4 + 20 + 32;
/// Messages of the measurement.
const MEASURED: u64 = 200;
/// Longest wait for one of them.
const WAIT: Duration = Duration::from_secs(10);

/// A kind of connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Way {
    CellToRouter,
    RouterToRouter,
    RouterToCell,
    RouterToScreen,
}

/// Messages and bytes per second.
#[derive(Clone, Copy, Debug, Default)]
struct Rate {
    messages: f64,
    bytes: f64,
}

impl Rate {
    fn add(&mut self, per_second: f64, bytes: usize) {
        self.messages += per_second;
        self.bytes += per_second * bytes as f64;
    }
}

/// The subscriber of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Reader {
    Cell(usize),
    Screen(usize),
}

impl Reader {
    fn router(self) -> usize {
        match self {
            Reader::Cell(cell) => cell / CELLS_OF_ROUTER,
            Reader::Screen(screen) => screen,
        }
    }
}

/// Subscriptions: those of one key, and those with `*`.
#[derive(Default)]
struct Subscriptions {
    exact: HashMap<String, Vec<Reader>>,
    wild: Vec<(KeyExpr<'static>, Reader)>,
}

impl Subscriptions {
    fn add(&mut self, key: String, reader: Reader) -> Result<(), Failure> {
        match key.contains('*') {
            true => self.wild.push((expression(key)?, reader)),
            false => self.exact.entry(key).or_default().push(reader),
        }
        Ok(())
    }

    fn readers(&self, key: &KeyExpr<'_>) -> Vec<Reader> {
        let exact = self.exact.get(key.as_str()).into_iter().flatten().copied();
        let wild = self.wild.iter().filter(|(wild, _)| wild.intersects(key));
        exact.chain(wild.map(|(_, reader)| *reader)).collect()
    }
}

fn expression(key: String) -> Result<KeyExpr<'static>, Failure> {
    KeyExpr::try_from(key.clone()).map_err(|error| format!("{key}: {error}").into())
}

fn keys(cell: usize) -> CellKeys {
    CellKeys::new("plant-1", &format!("cell-{cell:04}"))
}

fn topic(cell: usize, topic: usize) -> Result<String, Failure> {
    let key = keys(cell).topic(&format!("conveyor/belt-{topic}/position"));
    key.ok_or_else(|| "a topic without a key".into())
}

fn message() -> Result<Vec<u8>, Failure> {
    let message = TopicMessage {
        version: VERSION,
        sender: "0123456789abcdef".to_owned(),
        sequence: 123_456_789,
        sent_ns: 86_400_123_456_789,
        age_ns: 1_234_567,
        ty: "Real".to_owned(),
        unit: Some("m".to_owned()),
        value: 0.123_456_789_012_345_67.into(),
    };
    Ok(message.bytes()?)
}

fn overview() -> Result<Vec<u8>, Failure> {
    let overview = CellOverview {
        cycle: 86_400_000,
        nets: vec!["guarded-line#12".to_owned(), "belt#3".to_owned()],
        nets_count: 2,
        event: Some(OverviewEvent {
            time: "2026-11-21T16:02:03.123456Z".to_owned(),
            severity: "info".to_owned(),
            words: "`guarded-line#12` has started".to_owned(),
        }),
        ..CellOverview::default()
    };
    Ok(serde_json::to_vec(&overview)?)
}

/// Copies one direction of a connection and counts its bytes.
fn relay(mut from: TcpStream, mut to: TcpStream, count: &AtomicU64) {
    let mut buffer = [0; 65536];
    while let Ok(length @ 1..) = from.read(&mut buffer) {
        // Relaxed: read after the messages have arrived, which went through this thread.
        count.fetch_add(length as u64, Ordering::Relaxed);
        if to.write_all(&buffer[..length]).is_err() {
            break;
        }
    }
    // Either side may be gone.
    let _ = to.shutdown(Shutdown::Both);
}

/// Returns the bytes that Zenoh adds to the payload of a message for a reader of `subscribed`: for a subscription of that one
/// key a number that both sides agreed on, for one with `*` the whole key.
fn added(key: &str, subscribed: &str, payload: &[u8]) -> Result<usize, Failure> {
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp)?;
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let by_relay = vec![format!("tcp/{}", listener.local_addr()?)];
    let reader = session::open(&[format!("tcp/127.0.0.1:{port}")], &[], None)?;
    let counted = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&counted);
    std::thread::spawn(move || -> std::io::Result<()> {
        let (near, _) = listener.accept()?;
        let far = TcpStream::connect(("127.0.0.1", port))?;
        for stream in [&near, &far] {
            stream.set_nodelay(true)?;
        }
        let (back_from, back_to) = (far.try_clone()?, near.try_clone()?);
        std::thread::spawn(move || relay(back_from, back_to, &AtomicU64::new(0)));
        relay(near, far, &count);
        Ok(())
    });
    let sender = session::open(&[], &by_relay, None)?;
    let (told, arrivals) = channel();
    let subscriber = reader.declare_subscriber(subscribed).callback(move |_| {
        // The receiver ends with this function.
        let _ = told.send(());
    });
    let _subscriber = subscriber.wait().map_err(|error| error.to_string())?;
    let send = || {
        let put = sender
            .put(key, payload)
            .attachment(key)
            .express(true)
            .wait();
        put.map_err(|error| error.to_string())
    };
    // Until the subscription is known to the sender.
    while arrivals.try_recv().is_err() {
        send()?;
        std::thread::sleep(Duration::from_millis(2));
    }
    while arrivals.recv_timeout(Duration::from_millis(50)).is_ok() {}
    let before = counted.load(Ordering::Relaxed);
    for _ in 0..MEASURED {
        send()?;
        arrivals.recv_timeout(WAIT)?;
    }
    let bytes = (counted.load(Ordering::Relaxed) - before) / MEASURED;
    let bytes = usize::try_from(bytes)?;
    let added = bytes.checked_sub(payload.len());
    added.ok_or_else(|| "a message without its payload".into())
}

/// The declarations of all cells of a site.
fn subscriptions(cells: usize) -> Result<(Subscriptions, usize), Failure> {
    let mut all = Subscriptions::default();
    let mut declared = 0;
    for cell in 0..cells {
        let hall = cell / CELLS_OF_ROUTER * CELLS_OF_ROUTER;
        let next = hall + (cell - hall + 1) % CELLS_OF_ROUTER.min(cells - hall);
        for number in 0..TAKEN {
            all.add(topic(next, number)?, Reader::Cell(cell))?;
            declared += 1;
        }
        if cell % FAR_EVERY == 0 {
            all.add(
                topic((cell + CELLS_OF_ROUTER) % cells, 0)?,
                Reader::Cell(cell),
            )?;
            declared += 1;
        }
        // Requests, status, rights, and the token of the executor.
        declared += 4;
    }
    for screen in 0..SCREENS.min(cells.div_ceil(CELLS_OF_ROUTER)) {
        all.add(
            CellKeys::new("plant-1", "*").overview(),
            Reader::Screen(screen),
        )?;
        declared += 2;
    }
    Ok((all, declared))
}

/// Checks that no two keys of a site are the same, and that each request is read as it was written.
fn check_keys(cells: usize) -> Result<usize, Failure> {
    let mut seen = HashSet::new();
    for cell in 0..cells {
        let own = keys(cell);
        let peer = format!("plant-1/cell-{:04}", (cell + 1) % cells);
        let request = own.request(&peer, Operation::Start, "close-door");
        let read = own
            .parse_request(&request)
            .ok_or("a request that is not read")?;
        if (read.peer, read.net.as_str()) != (peer, "close-door") {
            return Err(format!("{request} is read as another request").into());
        }
        if keys((cell + 1) % cells.max(2))
            .parse_request(&request)
            .is_some()
        {
            return Err(format!("{request} is read by another cell").into());
        }
        let mut all = vec![
            own.overview(),
            own.status(),
            own.rights(),
            own.alive("0123456789abcdef"),
            request,
        ];
        all.extend([own.event("net_started"), own.net("guarded-line")]);
        for number in 0..TOPICS {
            all.push(topic(cell, number)?);
        }
        for key in all {
            expression(key.clone())?;
            if !seen.insert(key.clone()) {
                return Err(format!("two keys `{key}`").into());
            }
        }
    }
    Ok(seen.len())
}

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let cells: usize = arguments.next().map_or(Ok(1000), |text| text.parse())?;
    let rate_hz: f64 = arguments.next().map_or(Ok(50.0), |text| text.parse())?;
    let (value, overview) = (message()?, overview()?);
    let own = topic(0, 0)?;
    let of_value = added(&own, &own, &value)?;
    let all = CellKeys::new("plant-1", "*").overview();
    let of_overview = added(&keys(0).overview(), &all, &overview)?;
    let key_count = check_keys(cells)?;
    let (subscriptions, declared) = subscriptions(cells)?;
    let routers = cells.div_ceil(CELLS_OF_ROUTER);
    let mut total: BTreeMap<Way, Rate> = BTreeMap::new();
    let mut of_router = vec![Rate::default(); routers];
    let (mut published, mut leaves) = (0.0, 0.0);
    for cell in 0..cells {
        let bytes = value.len() + of_value;
        let topics = (0..TOPICS).map(|number| Ok((topic(cell, number)?, rate_hz, bytes)));
        let mut messages = topics.collect::<Result<Vec<(String, f64, usize)>, Failure>>()?;
        messages.push((keys(cell).overview(), 1.0, overview.len() + of_overview));
        messages.push((keys(cell).event("net_started"), EVENTS_HZ, 400));
        messages.push((keys(cell).net("guarded-line"), EVENTS_HZ, 150));
        for (key, per_second, message) in messages {
            let bytes = message + PACKET;
            let key = expression(key)?;
            let readers = subscriptions.readers(&key);
            published += per_second;
            // Zenoh sends nothing that nobody has asked for.
            if readers.is_empty() {
                continue;
            }
            leaves += per_second;
            let mut count = |way, at: &[usize]| {
                total.entry(way).or_default().add(per_second, bytes);
                for router in at {
                    of_router[*router].add(per_second, bytes);
                }
            };
            let own = cell / CELLS_OF_ROUTER;
            count(Way::CellToRouter, &[own]);
            let others: BTreeSet<usize> = readers.iter().map(|one| one.router()).collect();
            for other in others.into_iter().filter(|other| *other != own) {
                count(Way::RouterToRouter, &[own, other]);
            }
            for reader in readers {
                let way = match reader {
                    Reader::Cell(_) => Way::RouterToCell,
                    Reader::Screen(_) => Way::RouterToScreen,
                };
                count(way, &[reader.router()]);
            }
        }
    }
    println!(
        "{cells} cells, {routers} routers of {CELLS_OF_ROUTER} cells, {TOPICS} topics each at {rate_hz} Hz"
    );
    println!("{key_count} keys, all different; {declared} declarations, which every router knows");
    println!(
        "a value: payload {} + Zenoh {of_value} + packet {PACKET} = {} bytes",
        value.len(),
        value.len() + of_value + PACKET
    );
    println!(
        "an overview: payload {} + Zenoh with its key {of_overview} + packet {PACKET} = {} bytes",
        overview.len(),
        overview.len() + of_overview + PACKET
    );
    println!(
        "published: {published:.0} messages/s, of which {leaves:.0} have a reader and leave their cell"
    );
    let count_of_cells = cells as f64;
    for (way, rate) in &total {
        let (name, each, count) = match way {
            Way::CellToRouter => ("cell to router", "cell", count_of_cells),
            Way::RouterToRouter => ("router to router", "router", routers as f64),
            Way::RouterToCell => ("router to cell", "cell", count_of_cells),
            Way::RouterToScreen => ("router to screen", "screen", SCREENS.min(routers) as f64),
        };
        println!(
            "{name:<18} {:>10.0} messages/s {:>9.1} Mbit/s; each {each}: {:>7.0} messages/s {:>7.3} Mbit/s",
            rate.messages,
            rate.bytes * 8e-6,
            rate.messages / count,
            rate.bytes * 8e-6 / count,
        );
    }
    let busiest = of_router
        .iter()
        .map(|rate| rate.messages)
        .fold(0.0, f64::max);
    let most = of_router.iter().map(|rate| rate.bytes).fold(0.0, f64::max);
    println!(
        "the busiest router: {busiest:.0} messages/s in and out, {:.1} Mbit/s",
        most * 8e-6
    );
    Ok(())
}
