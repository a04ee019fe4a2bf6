//! The driver in the conformance suite, with the simulated I/O station in threads of the test.
//! Test code only.

use std::net::SocketAddr;
use std::sync::mpsc;

use rcc_config::{DeviceConfig, OnRelease};
use rcc_core::message::ANALOG_MAX;
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use serde_json::{Value, json};

use super::{Modbus, REASONS};
use crate::sim::io::options::Options;
use crate::sim::io::program;
use crate::sim::line_server::ControlClient;
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::capture::Capture;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport, device};
use rcc_driver_kit::driver::Inputs;
use rcc_driver_kit::host::reason::Reason;

/// The server; coil 0 is looped back to discrete input 0, holding register 0 to input register 0.
struct IoServer {
    address: SocketAddr,
    control: ControlClient,
}

impl IoServer {
    fn say(&mut self, line: &str) -> Value {
        let answer = self.control.ask(line).expect("an answer");
        serde_json::from_str(&answer).expect("JSON")
    }
}

impl Peer for IoServer {
    fn before_receive(&mut self) {}

    fn after_exchange(&mut self) {}

    fn set_present(&mut self, present: bool) {
        let time = if present { 0 } else { 600_000 };
        let answer = self.say(&format!("{{\"freeze_ms\": {time}}}"));
        assert_eq!(answer["ok"], true);
    }
}

impl Subject for IoServer {
    type Driver = Modbus;
    const NAME: &'static str = "modbus";
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::TcpFromDriver;
    const HAS_CHECKSUM: bool = false;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("server", "\"192.168.0.7\""),
        ("unit", "256"),
        ("unit", "-1"),
        ("period", "\"0 ms\""),
        ("period", "\"10\""),
        ("timeout", "\"1 m\""),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] = &[
        (DigitalOutput, "\"discrete 0\""),
        (DigitalOutput, "\"coil\""),
        (DigitalOutput, "\"coil 65536\""),
        (DigitalInput, "\"discrete 0 i16\""),
        (AnalogOutput, "\"input 0\""),
        (AnalogOutput, "\"holding 0\""),
    ];

    /// Runs until the test process ends.
    fn start() -> Self {
        let any = SocketAddr::from(([127, 0, 0, 1], 0));
        let wire = |text: &str| text.parse().expect("a wire");
        // Needed until the client is connected.
        let folder = rcc_testing::folder();
        let options = Options {
            bind: any,
            control: Some(folder.path().join("sim.sock")),
            wire: vec![wire("coil:0=discrete:0"), wire("holding:0=input:0")],
            priority: None,
            parent_death: false,
        };
        let (tell, told) = mpsc::channel();
        std::thread::spawn(move || {
            program::run(&options, |line| {
                tell.send(line.to_owned()).expect("the test waits")
            })
        });
        let line = told.recv().expect("the server starts");
        let place = |name: &str| {
            let rest = line.split(name).nth(1).expect("its address");
            rest.split(' ').next().expect("its address").to_owned()
        };
        let control = ControlClient::connect(place("control=")).expect("it listens");
        Self {
            address: place("modbus=").parse().expect("an address"),
            control,
        }
    }

    fn address(&self) -> SocketAddr {
        self.address
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        let safe = Some(OnRelease::Safe(0.0));
        let range = Some([-100.0, 100.0]);
        let settings = json!({"server": at.to_string(), "period": "1 ms", "timeout": "200 ms"});
        device(
            "modbus",
            settings,
            &[
                ("lamp", DigitalOutput, "coil 0".into(), safe, None),
                (
                    "clamp",
                    DigitalOutput,
                    "coil 1".into(),
                    Some(OnRelease::Hold),
                    None,
                ),
                ("lamp_on", DigitalInput, "discrete 0".into(), None, None),
                ("other", DigitalInput, "discrete 7".into(), None, None),
                ("speed", AnalogOutput, "holding 0 i16".into(), safe, range),
                ("speed_is", AnalogInput, "input 0 i16".into(), None, None),
            ],
        )
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let state = self.say("{\"state\": null}");
        let coil = |place: usize| u64::from(state["coils"][place] == true);
        let mut analog = [f64::NAN; ANALOG_MAX];
        let register = state["holding"][0].as_u64().expect("a register") as u16;
        analog[0] = f64::from(register.cast_signed());
        ObservedOutputs {
            digital: coil(0) | coil(1) << 1,
            analog,
        }
    }

    /// Ten exchanges with an independent server; the expected values are known from its source.
    fn capture() -> Option<Capture> {
        let text = include_str!("../../../../tests/data/modbus/libmodbus.txt");
        Some(Capture {
            device: libmodbus,
            packets: Capture::packets(text),
            exchanges: 10,
            check: |rows: &[Inputs]| {
                for inputs in rows {
                    assert_eq!(inputs.analog[..3], [123_456.0, -0.15625, -70_000.0]);
                    assert_eq!((inputs.digital, inputs.digital_known), (0, 0b11));
                }
            },
        })
    }
}

/// Configuration of the driver at the time of the capture.
fn libmodbus(at: SocketAddr) -> DeviceConfig {
    let settings = json!({"server": at.to_string(), "unit": 1, "period": "1 ms", "timeout": "2 s"});
    device(
        "modbus",
        settings,
        &[
            ("on", DigitalInput, "discrete 0".into(), None, None),
            ("off", DigitalInput, "discrete 15".into(), None, None),
            ("big", AnalogInput, "input 0 f32".into(), None, None),
            ("small", AnalogInput, "input 2 f32 CDAB".into(), None, None),
            ("count", AnalogInput, "input 8 i32".into(), None, None),
        ],
    )
}

conformance!(io: IoServer);
