//! The template in the conformance suite, with a simulated I/O box in a thread of its own.
//! Test code only.

use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use super::{LINE_MAX, LineIo, REASONS, crc32, parse, push, seal, unseal};
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::capture::Capture;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport, device};
use rcc_driver_kit::driver::Driver;
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{CellConfig, DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::message::ANALOG_MAX;
use rcc_driver_kit::rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use rcc_driver_kit::serde_json::json;

/// The simulated box; output 1 of each type is looped back to input 1.
struct TextIoBox {
    address: SocketAddr,
    outputs: Arc<Mutex<BTreeMap<String, f64>>>,
    present: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

fn live(
    socket: &UdpSocket,
    outputs: &Mutex<BTreeMap<String, f64>>,
    (present, stop): (&AtomicBool, &AtomicBool),
) {
    let mut bytes = [0; LINE_MAX];
    let mut newest = None;
    while !stop.load(Ordering::Relaxed) {
        let Ok((size, from)) = socket.recv_from(&mut bytes) else {
            continue;
        };
        let Some((word, number, values)) = unseal(&bytes[..size]).and_then(parse) else {
            continue;
        };
        let mut outputs = outputs.lock().expect("no panic");
        match word {
            _ if !present.load(Ordering::Relaxed) => {}
            "get" => {
                if number == 0 {
                    newest = None;
                }
                let mut line = format!("is {number}");
                for name in ["d1", "a1"] {
                    let value = outputs.get(name).copied().unwrap_or(0.0);
                    push(&mut line, if name == "d1" { 'd' } else { 'a' }, 1, value);
                }
                // The sender may be gone.
                drop(socket.send_to(seal(&line).as_bytes(), from));
            }
            "set" if newest.is_none_or(|newest| number > newest) => {
                newest = Some(number);
                outputs.extend(values);
            }
            _ => {}
        }
    }
}

impl Drop for TextIoBox {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

impl Peer for TextIoBox {
    fn before_receive(&mut self) {}

    fn after_exchange(&mut self) {}

    fn set_present(&mut self, present: bool) {
        self.present.store(present, Ordering::Relaxed);
    }
}

impl Subject for TextIoBox {
    type Driver = LineIo;
    const NAME: &'static str = "template";
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDriver;
    const HAS_CHECKSUM: bool = true;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("box", "\"192.168.0.7\""),
        ("period", "\"0 ms\""),
        ("period", "\"10\""),
        ("timeout", "\"-1 ms\""),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] =
        &[(DigitalInput, "0"), (AnalogOutput, "17")];

    fn start() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
        socket
            .set_read_timeout(Some(Duration::from_millis(10)))
            .expect("a socket");
        let mut own = Self {
            address: socket.local_addr().expect("an address"),
            outputs: Arc::default(),
            present: Arc::new(AtomicBool::new(true)),
            stop: Arc::default(),
            thread: None,
        };
        let outputs = Arc::clone(&own.outputs);
        let (present, stop) = (Arc::clone(&own.present), Arc::clone(&own.stop));
        let run = move || live(&socket, &outputs, (&present, &stop));
        own.thread = Some(std::thread::spawn(run));
        own
    }

    fn address(&self) -> SocketAddr {
        self.address
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        let safe = Some(OnRelease::Safe(0.0));
        let range = Some([0.0, 0.5]);
        let settings = json!({"box": at.to_string(), "period": "1 ms", "timeout": "20 ms"});
        device(
            "template",
            settings,
            &[
                ("lamp", DigitalOutput, 1.into(), safe, None),
                (
                    "clamp",
                    DigitalOutput,
                    2.into(),
                    Some(OnRelease::Hold),
                    None,
                ),
                ("lamp_on", DigitalInput, 1.into(), None, None),
                ("speed", AnalogOutput, 1.into(), safe, range),
                ("speed_is", AnalogInput, 1.into(), None, None),
            ],
        )
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let outputs = self.outputs.lock().expect("no panic");
        let value = |name: &str| outputs.get(name).copied();
        let bit = |name: &str| u64::from(value(name).is_some_and(|value| value != 0.0));
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = value("a1").unwrap_or(f64::NAN);
        ObservedOutputs {
            digital: bit("d1") | bit("d2") << 1,
            analog,
        }
    }

    fn capture() -> Option<Capture> {
        None
    }
}

conformance!(io: TextIoBox);

#[test]
fn a_line_is_taken_with_its_check_only() {
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    let sealed = seal("is 7 d1=1 a1=0.25");
    let line = unseal(sealed.as_bytes());
    assert_eq!(line, Some("is 7 d1=1 a1=0.25"));
    let (word, number, values) = line.and_then(parse).expect("a line");
    assert_eq!((word, number, values["a1"]), ("is", 7, 0.25));
    assert_eq!(unseal(sealed.replace("d1=1", "d1=0").as_bytes()), None);
    for bad in ["", "is", "is x", "is 7 d1", "is 7 a1=NaN", "is 7 a1=x"] {
        assert_eq!(parse(bad), None, "{bad}");
    }
}

#[test]
fn the_cell_of_this_folder_opens() {
    let text = include_str!("../../cell.yaml");
    let cell = CellConfig::parse(text, "cell.yaml", Path::new(""), &BTreeMap::new());
    let cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
    let opened = LineIo::open(&cell.devices[0]);
    assert!(opened.is_ok(), "{:?}", opened.err());
}
