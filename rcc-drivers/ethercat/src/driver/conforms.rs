//! The driver in the conformance suite of the kit, with a simulated line in a thread of the test, over UDP.
//! Test code only.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport, device};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::message::ANALOG_MAX;
use rcc_driver_kit::rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use serde_json::json;

use super::{Ethercat, NAME, REASONS};
use crate::sim::line::Line;
use crate::terminals::{MODELS, Model};
use crate::wire::{Interface, PACKET_MAX, Socket};

/// Longest time until the end of the thread is noticed.
const STEP: Duration = Duration::from_millis(10);

/// The line; output 1 of each type is wired to input 1.
struct SimulatedLine {
    address: SocketAddr,
    line: Arc<Mutex<Line>>,
    present: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

fn live(socket: &Socket, line: &Mutex<Line>, (present, stop): (&AtomicBool, &AtomicBool)) {
    let started = Instant::now();
    let mut packet = [0; PACKET_MAX];
    while !stop.load(Ordering::Relaxed) {
        socket.wait(Some(STEP)).expect("a socket");
        while let Ok(Some(size)) = socket.receive(&mut packet) {
            let frame = &mut packet[..size];
            let is_present = present.load(Ordering::Relaxed);
            let mut line = line.lock().expect("no panic");
            if is_present && line.exchange(frame, started.elapsed()) == Ok(true) {
                // The sender may be gone.
                drop(socket.send(frame));
            }
        }
        line.lock().expect("no panic").advance(started.elapsed());
    }
}

impl SimulatedLine {
    /// A line of these terminals.
    fn of<'a>(models: impl Iterator<Item = &'static Model> + 'a) -> SimulatedLine {
        let any = Interface::read("udp 127.0.0.1:0").expect("an address");
        let socket = Socket::line(&any).expect("loopback");
        let mut line = Line::new(&models.collect::<Vec<_>>());
        line.wires = ["2.1=1.1", "4.1=3.1"]
            .map(|wire| wire.parse().expect("a wire"))
            .to_vec();
        let mut own = Self {
            address: socket.address().expect("an address"),
            line: Arc::new(Mutex::new(line)),
            present: Arc::new(AtomicBool::new(true)),
            stop: Arc::default(),
            thread: None,
        };
        let line = Arc::clone(&own.line);
        let (present, stop) = (Arc::clone(&own.present), Arc::clone(&own.stop));
        let run = move || live(&socket, &line, (&present, &stop));
        own.thread = Some(std::thread::spawn(run));
        own
    }
}

impl Drop for SimulatedLine {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

impl Peer for SimulatedLine {
    fn before_receive(&mut self) {}

    fn after_exchange(&mut self) {}

    fn set_present(&mut self, present: bool) {
        self.present.store(present, Ordering::Relaxed);
    }
}

impl Subject for SimulatedLine {
    type Driver = Ethercat;
    const NAME: &'static str = NAME;
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDriver;
    const HAS_CHECKSUM: bool = false;
    const CAN_BE_REPLAYED: bool = false;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("interface", "\"a/b\""),
        ("interface", "\"udp 127.0.0.1\""),
        ("period", "\"0 ms\""),
        ("period", "\"1\""),
        ("timeout", "\"-1 ms\""),
        ("lost_after", "0"),
        ("lost_after", "10001"),
        ("watchdog", "\"7 s\""),
        ("watchdog", "\"1 ms\""),
        ("distributed_clocks", "{\"shift\": \"2 ms\"}"),
        ("distributed_clocks", "{\"offset\": \"0.5 ms\"}"),
        ("terminals", "{}"),
        (
            "terminals",
            "{\"in\": {\"position\": 0, \"type\": \"EL1008\"}}",
        ),
        (
            "terminals",
            "{\"in\": {\"position\": 1, \"type\": \"EL9\"}}",
        ),
        (
            "terminals",
            "{\"in\": {\"position\": 2, \"type\": \"EL1008\"}}",
        ),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] = &[
        (DigitalInput, "\"in channel 9\""),
        (DigitalInput, "\"out channel 1\""),
        (DigitalOutput, "\"out channel 0\""),
        (DigitalOutput, "\"in bit 0\""),
        (AnalogInput, "\"ain channel 5\""),
        (AnalogOutput, "\"aout byte 7 i16\""),
    ];

    fn start() -> Self {
        SimulatedLine::of(MODELS.iter().take(4))
    }

    fn address(&self) -> SocketAddr {
        self.address
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        let safe = Some(OnRelease::Safe(0.0));
        let range = Some([-100.0, 100.0]);
        // Times that a busy machine keeps.
        let settings = json!({
            "interface": format!("udp {at}"),
            "period": "1 ms",
            "timeout": "40 ms",
            "lost_after": 3,
            "watchdog": "1 s",
            "terminals": {
                "in": {"position": 1, "type": "EL1008"},
                "out": {"position": 2, "type": "EL2008"},
                "ain": {"position": 3, "type": "EL3064"},
                "aout": {"position": 4, "type": "EL4004"},
            },
        });
        device(
            NAME,
            settings,
            &[
                ("lamp", DigitalOutput, "out channel 1".into(), safe, None),
                (
                    "clamp",
                    DigitalOutput,
                    "out bit 1".into(),
                    Some(OnRelease::Hold),
                    None,
                ),
                ("lamp_on", DigitalInput, "in channel 1".into(), None, None),
                ("other", DigitalInput, "in bit 7".into(), None, None),
                ("speed", AnalogOutput, "aout channel 1".into(), safe, range),
                ("speed_is", AnalogInput, "ain channel 1".into(), None, None),
            ],
        )
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let line = self.line.lock().expect("no panic");
        let outputs = |position: usize| line.stations[position].outputs();
        let digital = outputs(1);
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = f64::from(outputs(3)[0]);
        ObservedOutputs {
            digital: u64::from(digital[0] != 0) | u64::from(digital[1] != 0) << 1,
            analog,
        }
    }
}

conformance!(io: SimulatedLine);

mod drives;
