//! The driver `modbus` against independent servers: libmodbus (Debian: libmodbus-dev, compiled with cc) and pymodbus
//! (Debian: python3-pymodbus python3-serial python3-serial-asyncio). Servers that are not installed are skipped by
//! name.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use rcc_config::{ChannelConfig, DeviceConfig, OnRelease};
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use rcc_core::unit::Unit;
use rcc_driver_kit::driver::{Driver, Exchange, Inputs, LinkError, Outputs};
use rcc_drivers::drivers::modbus::Modbus;
use rcc_drivers::drivers::modbus::fault::{EXCEPTIONS, NAMED, TIMEOUT, UNREACHABLE};
use serde_json::{Value, json};

/// Number of exchanges, or attempts, within which an expected event must happen.
const PATIENCE: usize = 3000;

/// How a server is started.
#[derive(Clone, Debug)]
enum Kind {
    /// A compiled program; each answer is delayed by this number of milliseconds.
    Libmodbus {
        delay_ms: u32,
    },
    Pymodbus,
}

/// A running server; killed when the test ends.
struct Peer {
    kind: Kind,
    address: SocketAddr,
    child: Option<Child>,
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.kill();
    }
}

impl Peer {
    /// Returns `None`, with a message, if the server is not installed.
    fn start(kind: Kind) -> Option<Self> {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
        let mut peer = Self {
            kind,
            address: free.unwrap(),
            child: None,
        };
        peer.run().then_some(peer)
    }

    fn run(&mut self) -> bool {
        let port = self.address.port().to_string();
        let command = match &self.kind {
            Kind::Libmodbus { delay_ms } => libmodbus().map(|program| {
                let mut command = Command::new(program);
                command.args([port, delay_ms.to_string()]);
                command
            }),
            Kind::Pymodbus => pymodbus().map(|python| {
                let mut command = Command::new(python);
                command.arg(source("pymodbus_server.py")).arg(port);
                command
            }),
        };
        let Some(mut command) = command else {
            return false;
        };
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let stdout = child.stdout.take().unwrap();
        BufReader::new(stdout).read_line(&mut line).unwrap();
        self.child = Some(child);
        assert_eq!(line.trim(), "ready", "{:?}", self.kind);
        true
    }

    fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            // It may have ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/modbus_peers")
        .join(name)
}

/// Returns the C program, compiled once.
fn libmodbus() -> Option<&'static Path> {
    static PROGRAM: OnceLock<Option<PathBuf>> = OnceLock::new();
    let compile = || {
        let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("libmodbus_server");
        let compiled = Command::new("cc")
            .args(["-I/usr/include/modbus", "-o"])
            .arg(&program)
            .arg(source("libmodbus_server.c"))
            .arg("-lmodbus")
            .output();
        let done = compiled.is_ok_and(|output| output.status.success());
        if !done {
            eprintln!("skipped: no libmodbus (Debian: libmodbus-dev) or no cc");
        }
        done.then_some(program)
    };
    PROGRAM.get_or_init(compile).as_deref()
}

/// Returns a Python interpreter that has pymodbus.
fn pymodbus() -> Option<&'static str> {
    static PYTHON: OnceLock<Option<&'static str>> = OnceLock::new();
    *PYTHON.get_or_init(|| {
        let has_it = |python: &&str| {
            let import = "from pymodbus.server import StartTcpServer; from pymodbus.payload import BinaryPayloadBuilder";
            let output = Command::new(python).args(["-c", import]).output();
            output.is_ok_and(|output| output.status.success())
        };
        let found = ["python3", "/usr/bin/python3"].into_iter().find(has_it);
        if found.is_none() {
            eprintln!("skipped: no pymodbus 3.0 (Debian: python3-pymodbus python3-serial python3-serial-asyncio)");
        }
        found
    })
}

type Row<'a> = (&'a str, ChannelKind, &'a str);

fn device(settings: Value, rows: &[Row<'_>]) -> DeviceConfig {
    let channel = |(place, (name, kind, address)): (usize, &Row<'_>)| {
        let output = matches!(kind, AnalogOutput | DigitalOutput);
        let before = rows[..place].iter().filter(|other| other.1 == *kind);
        ChannelConfig {
            name: (*name).to_owned(),
            kind: *kind,
            index: before.count() as u32,
            address: (*address).into(),
            unit: Unit::ONE,
            scale: 1.0,
            offset: 0.0,
            range: (*kind == AnalogOutput).then_some([-1e4, 1e4]),
            on_release: output.then_some(OnRelease::Safe(0.0)),
        }
    };
    DeviceConfig {
        name: "io".to_owned(),
        driver: rcc_config::DriverConfig::Name("modbus".to_owned()),
        folder: std::path::PathBuf::new(),
        robot: None,
        settings,
        channels: rows.iter().enumerate().map(channel).collect(),
        first_tolerance_rad: 2e-3,
        base: rcc_core::pose::Pose::IDENTITY,
        workspace: None,
        command_timeout_ns: 50_000_000,
        delay_ns: 10_000_000,
    }
}

fn open(settings: Value, rows: &[Row<'_>]) -> Modbus {
    Modbus::open(&device(settings, rows)).unwrap()
}

fn one(peer: &Peer) -> Value {
    json!({"server": peer.address.to_string(), "unit": 1, "period": "2 ms", "timeout": "1 s"})
}

/// Exchanges until `done` returns true; returns the inputs at that moment.
fn until(
    driver: &mut Modbus,
    outputs: &Outputs,
    what: &str,
    mut done: impl FnMut(&Result<Exchange, LinkError>, &Inputs) -> bool,
) -> Inputs {
    let mut inputs = Inputs::NONE;
    for _ in 0..PATIENCE {
        let result = driver.receive(Duration::from_millis(20), &mut inputs);
        if result.is_ok() {
            // A loss is detected at the next receive.
            let _ = driver.send(outputs);
        }
        if done(&result, &inputs) {
            return inputs;
        }
    }
    panic!("never: {what}");
}

fn exchanged(driver: &mut Modbus) -> Inputs {
    until(driver, &Outputs::NONE, "an exchange", |result, _| {
        result.is_ok()
    })
}

fn lost_by(driver: &mut Modbus, reasons: &[u32]) {
    until(
        driver,
        &Outputs::NONE,
        &format!("a loss by {reasons:?}"),
        |result, _| matches!(result, Err(LinkError::Lost { reason }) if reasons.contains(reason)),
    );
}

#[test]
fn every_word_order_is_read_as_libmodbus_wrote_it() {
    let Some(peer) = Peer::start(Kind::Libmodbus { delay_ms: 0 }) else {
        return;
    };
    let rows = [
        ("abcd", AnalogInput, "input 0 f32"),
        ("cdab", AnalogInput, "input 2 f32 CDAB"),
        ("badc", AnalogInput, "input 4 f32 BADC"),
        ("dcba", AnalogInput, "input 6 f32 DCBA"),
        ("int", AnalogInput, "input 8 i32"),
        ("long", AnalogInput, "input 10 i64"),
        ("word", AnalogInput, "input 14"),
        ("bit", DigitalInput, "discrete 20"),
        ("other", DigitalInput, "discrete 21"),
        ("high", DigitalInput, "input 14 bit 15"),
    ];
    let inputs = exchanged(&mut open(one(&peer), &rows));
    let expected = [
        123_456.0, -0.15625, 123_456.0, -0.15625, -70_000.0, -5e9, 65_535.0,
    ];
    assert_eq!(inputs.analog[..7], expected);
    assert_eq!((inputs.digital, inputs.digital_known), (0b101, 0b111));
}

#[test]
fn every_word_order_is_written_as_libmodbus_reads_it() {
    let Some(peer) = Peer::start(Kind::Libmodbus { delay_ms: 0 }) else {
        return;
    };
    let rows = [
        ("abcd", AnalogOutput, "holding 0 f32"),
        ("cdab", AnalogOutput, "holding 2 f32 CDAB"),
        ("badc", AnalogOutput, "holding 4 f32 BADC"),
        ("dcba", AnalogOutput, "holding 6 f32 DCBA"),
        ("int", AnalogOutput, "holding 8 i32"),
        ("bit", DigitalOutput, "coil 3"),
        ("register_bit", DigitalOutput, "holding 50 bit 9"),
        ("abcd_is", AnalogInput, "input 100 i16"),
        ("cdab_is", AnalogInput, "input 101 i16"),
        ("badc_is", AnalogInput, "input 102 i16"),
        ("dcba_is", AnalogInput, "input 103 i16"),
        ("int_is", AnalogInput, "input 104 i16"),
        ("register_is", AnalogInput, "holding 50"),
        ("bit_is", DigitalInput, "discrete 3"),
    ];
    let mut outputs = Outputs {
        digital: 0b11,
        digital_set: 0b11,
        ..Outputs::NONE
    };
    outputs.analog[..5].copy_from_slice(&[12.5, -3.5, 100.0, -0.5, -9000.0]);
    let expected = [125.0, -35.0, 1000.0, -5.0, -9.0, 512.0];
    let mut driver = open(one(&peer), &rows);
    until(&mut driver, &outputs, "what was written", |_, inputs| {
        inputs.analog[..6] == expected && inputs.digital & 1 == 1
    });
    // The driver sends its last outputs when it is dropped; a new driver reads the present state first.
    driver
        .send(&Outputs {
            digital: 0,
            ..outputs
        })
        .unwrap();
    drop(driver);
    let mut reader = open(one(&peer), &[("bit_is", DigitalInput, "discrete 3")]);
    assert_eq!(exchanged(&mut reader).digital, 0);
}

#[test]
fn every_type_in_every_order_is_read_as_pymodbus_packed_it() {
    let Some(peer) = Peer::start(Kind::Pymodbus) else {
        return;
    };
    let types = ["u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64"];
    let values = [
        65_535.0,
        -2.0,
        4e9,
        -70_000.0,
        9_007_199_254_740_992.0,
        -5e9,
        -0.15625,
        1e-9,
    ];
    let orders = [
        ["AB", "ABCD", "ABCDEFGH"],
        ["AB", "CDAB", "GHEFCDAB"],
        ["BA", "DCBA", "HGFEDCBA"],
        ["BA", "BADC", "BADCFEHG"],
    ];
    for (letters, block) in orders.into_iter().zip(0..) {
        let mut address = 24 * block;
        let mut addresses = Vec::new();
        for name in types {
            let (width, order) = match &name[1..] {
                "16" => (1, letters[0]),
                "32" => (2, letters[1]),
                _ => (4, letters[2]),
            };
            addresses.push(format!("input {address} {name} {order}"));
            address += width;
        }
        let rows = types.iter().zip(&addresses);
        let rows: Vec<Row<'_>> = rows
            .map(|(name, address)| (*name, AnalogInput, address.as_str()))
            .collect();
        let inputs = exchanged(&mut open(one(&peer), &rows));
        assert_eq!(inputs.analog[..8], values, "{letters:?}");
    }
}

#[test]
fn units_are_told_apart() {
    let Some(peer) = Peer::start(Kind::Pymodbus) else {
        return;
    };
    let rows = [
        ("one", AnalogInput, "one/input 1"),
        ("two", AnalogInput, "two/input 1"),
    ];
    let settings = |two: u8| {
        let address = peer.address.to_string();
        let server = |unit| json!({"address": address, "unit": unit, "timeout": "100 ms"});
        json!({"period": "2 ms", "servers": {"one": server(1), "two": server(two)}})
    };
    assert_eq!(
        exchanged(&mut open(settings(2), &rows)).analog[..2],
        [65_534.0, 2222.0]
    );
    // Some versions do not answer for a unit that they do not have; others report that the gateway has no path.
    let reasons = [TIMEOUT, EXCEPTIONS + 11].map(|reason| 2 * NAMED + reason);
    lost_by(&mut open(settings(9), &rows), &reasons);
}

#[test]
fn an_address_that_the_server_does_not_have_is_its_exception_2() {
    for kind in [Kind::Libmodbus { delay_ms: 0 }, Kind::Pymodbus] {
        let Some(peer) = Peer::start(kind) else {
            continue;
        };
        let mut driver = open(one(&peer), &[("far", DigitalInput, "discrete 5000")]);
        lost_by(&mut driver, &[EXCEPTIONS + 2]);
    }
}

#[test]
fn a_server_that_was_killed_is_lost_and_gets_its_outputs_again_when_it_is_back() {
    for kind in [Kind::Libmodbus { delay_ms: 0 }, Kind::Pymodbus] {
        let Some(mut peer) = Peer::start(kind) else {
            continue;
        };
        let rows = [
            ("lamp", DigitalOutput, "coil 5"),
            ("lamp_is", DigitalInput, "coil 5"),
        ];
        let outputs = Outputs {
            digital: 1,
            digital_set: 1,
            ..Outputs::NONE
        };
        let mut driver = open(one(&peer), &rows);
        until(&mut driver, &outputs, "the lamp", |_, inputs| {
            inputs.digital == 1
        });
        peer.kill();
        lost_by(&mut driver, &[UNREACHABLE]);
        assert!(peer.run());
        // The server starts with everything off.
        until(&mut driver, &outputs, "the lamp again", |result, inputs| {
            result.is_ok() && inputs.digital == 1
        });
    }
}

#[test]
fn a_slow_server_is_exchanged_with_as_fast_as_it_answers() {
    let Some(peer) = Peer::start(Kind::Libmodbus { delay_ms: 7 }) else {
        return;
    };
    let rows = [
        ("lamp", DigitalOutput, "coil 5"),
        ("lamp_is", DigitalInput, "coil 5"),
    ];
    let mut driver = open(one(&peer), &rows);
    for on in [1, 0, 1] {
        let outputs = Outputs {
            digital: on,
            digital_set: 1,
            ..Outputs::NONE
        };
        until(&mut driver, &outputs, "the lamp", |_, inputs| {
            inputs.digital == on
        });
    }
}

#[test]
fn half_an_answer_is_no_answer_and_the_next_connection_is_tried() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let settings =
        json!({"server": listener.local_addr().unwrap().to_string(), "timeout": "50 ms"});
    let server = std::thread::spawn(move || {
        let mut request = [0; 12];
        // Half an answer to each request, so that the driver closes the connection.
        let (mut stream, _) = listener.accept().unwrap();
        while stream.read_exact(&mut request).is_ok() {
            let half = [request[0], request[1], 0, 0, 0, 4, 255, 2];
            if stream.write_all(&half).is_err() {
                break;
            }
        }
        let (mut stream, _) = listener.accept().unwrap();
        while stream.read_exact(&mut request).is_ok() {
            let whole = [request[0], request[1], 0, 0, 0, 4, 255, 2, 1, 1];
            if stream.write_all(&whole).is_err() {
                break;
            }
        }
    });
    let mut driver = open(settings, &[("door", DigitalInput, "discrete 0")]);
    until(&mut driver, &Outputs::NONE, "a loss", |result, inputs| {
        assert_eq!(inputs.digital_known, 0, "half an answer is believed");
        matches!(result, Err(LinkError::Lost { .. }))
    });
    let inputs = exchanged(&mut driver);
    assert_eq!((inputs.digital, inputs.digital_known), (1, 1));
    drop(driver);
    server.join().unwrap();
}
