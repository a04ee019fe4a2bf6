//! The driver against the simulated I/O station, which runs in a thread of the test.

mod misbehaving_server;

use std::net::{SocketAddr, TcpListener};
use std::sync::mpsc;

use rcc_config::OnRelease;
use rcc_core::primitive::ChannelKind::{AnalogInput, AnalogOutput, DigitalInput, DigitalOutput};

use super::*;
use crate::sim::io::options::Options;
use crate::sim::io::program;
use crate::sim::line_server::ControlClient;
use rcc_driver_kit::conformance::{self, ChannelRow, Peer};

fn rows() -> [ChannelRow<'static>; 6] {
    let safe = Some(OnRelease::Safe(0.0));
    [
        ("lamp", DigitalOutput, "coil 0".into(), safe, None),
        ("lamp_on", DigitalInput, "discrete 0".into(), None, None),
        ("other", DigitalInput, "discrete 7".into(), None, None),
        (
            "speed",
            AnalogOutput,
            "holding 0 i16".into(),
            safe,
            Some([-100.0, 100.0]),
        ),
        ("speed_is", AnalogInput, "input 0 i16".into(), None, None),
        (
            "speed_was_told",
            AnalogInput,
            "holding 0 i16".into(),
            None,
            None,
        ),
    ]
}

fn device(server: SocketAddr) -> DeviceConfig {
    let settings = serde_json::json!({
        "server": server.to_string(),
        "period": "1 ms",
        "timeout": "200 ms",
    });
    conformance::device("modbus", settings, &rows())
}

/// The server: it is started when it is first made present, and can be frozen later.
struct FreezableServer {
    address: SocketAddr,
    control: Option<ControlClient>,
    frozen: bool,
}

impl FreezableServer {
    fn nowhere() -> Self {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
        Self {
            address: free.expect("loopback"),
            control: None,
            frozen: false,
        }
    }

    /// Runs until the test process ends.
    fn start(&mut self) {
        // Needed until the client is connected.
        let folder = rcc_testing::folder();
        let options = Options {
            bind: self.address,
            control: Some(folder.path().join("sim.sock")),
            wire: vec![
                "coil:0=discrete:0".parse().expect("a wire"),
                "holding:0=input:0".parse().expect("a wire"),
            ],
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
        let control = line.split("control=").nth(1).expect("its path");
        self.control = Some(ControlClient::connect(control).expect("it listens"));
    }

    fn say(&mut self, line: &str) {
        let control = self.control.as_mut().expect("it runs");
        let answer = control.ask(line).expect("an answer");
        assert!(answer.contains("ok"), "{answer}");
    }
}

impl Peer for FreezableServer {
    fn before_receive(&mut self) {}

    fn after_exchange(&mut self) {}

    fn set_present(&mut self, present: bool) {
        if present && self.control.is_none() {
            self.start();
        } else if self.control.is_some() && present == self.frozen {
            self.frozen = !present;
            let time = if present { 0 } else { 600_000 };
            self.say(&format!("{{\"freeze_ms\": {time}}}"));
        }
    }
}

#[test]
fn signed_registers_are_read_back_as_they_were_written() {
    let mut server = FreezableServer::nowhere();
    server.start();
    let mut driver = Modbus::open(&device(server.address)).expect("a good configuration");
    let mut outputs = Outputs::NONE;
    outputs.analog[0] = -73.4;
    let mut inputs = Inputs::NONE;
    for _ in 0..1000 {
        let result = conformance::exchange(&mut driver, &mut server, &mut inputs, &outputs);
        if result.is_ok() && inputs.analog[1] == -73.0 {
            break;
        }
    }
    assert_eq!(inputs.analog[..2], [-73.0, -73.0]);
}

#[test]
fn every_output_is_written_again_on_a_new_connection() {
    let mut server = FreezableServer::nowhere();
    server.start();
    let station_at = server.address;
    let mut driver = Modbus::open(&device(station_at)).expect("a good configuration");
    let outputs = Outputs {
        digital: 1,
        digital_set: 1,
        ..Outputs::NONE
    };
    let mut inputs = Inputs::NONE;
    let mut lamp = |driver: &mut Modbus, outputs: &Outputs, on: bool| {
        (0..1000).any(|_| {
            let result = conformance::exchange(driver, &mut server, &mut inputs, outputs);
            result.is_ok() && inputs.digital & 1 == u64::from(on)
        })
    };
    assert!(lamp(&mut driver, &outputs, true));
    // Another client switches it off without the driver's knowledge.
    let mut other = Modbus::open(&device(station_at)).expect("a good configuration");
    assert!(lamp(
        &mut other,
        &Outputs {
            digital: 0,
            ..outputs
        },
        false
    ));
    let now = Instant::now();
    driver.connections[0].server.connected(now);
    assert!(lamp(&mut driver, &outputs, true));
}

#[test]
fn addresses_that_do_not_fit_their_channel_are_refused() {
    for (row, address, words) in [
        (0, "discrete 0", "is not a valid address"),
        (0, "coil", "is not a valid address"),
        (0, "coil 65536", "is not a valid address"),
        (1, "discrete 0 i16", "is not a valid address"),
        (3, "input 0", "is not a valid address"),
        (3, "holding 0", "does not fit u16"),
    ] {
        let mut rows = rows();
        rows[row].2 = address.into();
        let settings = serde_json::json!({"server": "127.0.0.1:502"});
        let device = conformance::device("modbus", settings, &rows);
        let fault = Modbus::open(&device)
            .expect_err("a bad address")
            .to_string();
        assert!(
            fault.contains(words) && fault.contains(rows[row].0),
            "{fault}"
        );
    }
}

#[test]
fn an_analog_output_needs_a_range() {
    let mut rows = rows();
    rows[3].4 = None;
    let settings = serde_json::json!({"server": "127.0.0.1:502"});
    let fault = Modbus::open(&conformance::device("modbus", settings, &rows));
    assert!(
        fault
            .expect_err("no range")
            .to_string()
            .contains("needs a range")
    );
}

#[test]
fn an_invalid_setting_is_refused_with_its_path() {
    for (key, value) in [
        ("period", "10"),
        ("server", "localhost"),
        ("timeout", "1 m"),
    ] {
        let mut device = device("127.0.0.1:502".parse().expect("an address"));
        device.settings[key] = value.into();
        let fault = Modbus::open(&device)
            .expect_err("a bad setting")
            .to_string();
        assert!(
            fault.starts_with(&format!("devices.device.settings.{key}: ")),
            "{fault}"
        );
    }
}
