//! The driver `modbus` with several servers, each an `io-sim` of its own; and the cell of docs/modbus.md.
//! Runs in the test harness; the system chooses the ports.

mod common;

use std::path::Path;
use std::time::Duration;

use common::Simulator;
use rcc_config::{CellConfig, ChannelConfig, DeviceConfig, OnRelease};
use rcc_core::primitive::ChannelKind::{self, DigitalInput, DigitalOutput};
use rcc_core::unit::Unit;
use rcc_driver_kit::driver::{Driver, Exchange, Inputs, LinkError, Outputs};
use rcc_drivers::drivers::modbus::Modbus;
use rcc_drivers::drivers::modbus::fault::{EXCEPTIONS, NAMED, TIMEOUT, UNREACHABLE};
use serde_json::json;

/// Number of exchanges, or attempts, within which an expected event must happen.
const PATIENCE: usize = 3000;

fn start(arguments: &[&str]) -> Simulator {
    Simulator::start(env!("CARGO_BIN_EXE_io-sim"), arguments)
}

/// Starts a simulator at this address whose coil 0 is wired to its discrete input 0.
fn start_at(bind: &str) -> Simulator {
    start(&["--wire=coil:0=discrete:0", "--bind", bind])
}

/// Opens a driver with a lamp and its echo on each of the servers `a` and `b`.
fn open(servers: [&Simulator; 2], timeout: &str) -> Modbus {
    let rows = [
        ("lamp_a", DigitalOutput, "a/coil 0"),
        ("lamp_b", DigitalOutput, "b/coil 0"),
        ("lamp_a_is", DigitalInput, "a/discrete 0"),
        ("lamp_b_is", DigitalInput, "b/discrete 0"),
    ];
    let channel = |(place, row): (usize, &(&str, ChannelKind, &str))| ChannelConfig {
        name: row.0.to_owned(),
        kind: row.1,
        index: place as u32 % 2,
        address: row.2.into(),
        unit: Unit::ONE,
        scale: 1.0,
        offset: 0.0,
        range: None,
        on_release: (row.1 == DigitalOutput).then_some(OnRelease::Safe(0.0)),
    };
    let server = |one: &Simulator| json!({"address": one.modbus().to_string(), "timeout": timeout, "back_off": "60 ms"});
    let device = DeviceConfig {
        name: "io".to_owned(),
        driver: rcc_config::DriverConfig::Name("modbus".to_owned()),
        folder: std::path::PathBuf::new(),
        robot: None,
        settings: json!({"period": "2 ms", "servers": {"a": server(servers[0]), "b": server(servers[1])}}),
        channels: rows.iter().enumerate().map(channel).collect(),
        first_tolerance_rad: 2e-3,
        base: rcc_core::pose::Pose::IDENTITY,
        workspace: None,
        command_timeout_ns: 50_000_000,
        delay_ns: 10_000_000,
    };
    Modbus::open(&device).unwrap()
}

const BOTH_ON: Outputs = Outputs {
    digital: 0b11,
    digital_set: 0b11,
    ..Outputs::NONE
};

fn until(
    driver: &mut Modbus,
    outputs: &Outputs,
    what: &str,
    mut done: impl FnMut(&Result<Exchange, LinkError>, &Inputs) -> bool,
) -> usize {
    let mut inputs = Inputs::NONE;
    for count in 0..PATIENCE {
        let result = driver.receive(Duration::from_millis(20), &mut inputs);
        if result.is_ok() {
            // A loss is detected at the next receive.
            let _ = driver.send(outputs);
        }
        if done(&result, &inputs) {
            return count;
        }
    }
    panic!("never: {what}");
}

fn both_on(driver: &mut Modbus) {
    until(driver, &BOTH_ON, "both lamps", |result, inputs| {
        result.is_ok() && inputs.digital == 0b11
    });
}

fn lost_by(driver: &mut Modbus, reasons: &[u32]) {
    until(
        driver,
        &BOTH_ON,
        &format!("a loss by {reasons:?}"),
        |result, _| matches!(result, Err(LinkError::Lost { reason }) if reasons.contains(reason)),
    );
}

#[test]
fn a_lost_server_takes_the_device_with_it_and_the_others_are_released() {
    let mut a = start_at("127.0.0.1:0");
    let b = start_at("127.0.0.1:0");
    let mut driver = open([&a, &b], "1 s");
    both_on(&mut driver);
    let at = b.modbus().to_string();
    drop(b);
    lost_by(&mut driver, &[2 * NAMED + UNREACHABLE]);
    until(&mut driver, &BOTH_ON, "the other lamp off", |result, _| {
        assert!(result.is_err(), "one server is gone");
        a.state()["coils"][0] == false
    });
    let _back = start_at(&at);
    both_on(&mut driver);
}

#[test]
fn a_slow_server_does_not_delay_the_others() {
    let (mut a, mut b) = (start_at("127.0.0.1:0"), start_at("127.0.0.1:0"));
    let mut driver = open([&a, &b], "10 s");
    both_on(&mut driver);
    let before = [&mut a, &mut b].map(|one| one.state()["requests"].as_u64().unwrap());
    b.ask(r#"{"delay_ms":100}"#);
    for _ in 0..100 {
        let result = driver.receive(Duration::from_millis(20), &mut Inputs::NONE.clone());
        if result.is_ok() {
            driver.send(&BOTH_ON).unwrap();
        }
    }
    let after = [&mut a, &mut b].map(|one| one.state()["requests"].as_u64().unwrap());
    let [fast, slow] = [0, 1].map(|place| after[place] - before[place]);
    assert!(
        fast > 5 * slow,
        "{fast} requests to the fast one, {slow} to the slow one"
    );
    // Outputs still reach the slow server.
    let outputs = Outputs {
        digital: 0b01,
        ..BOTH_ON
    };
    until(&mut driver, &outputs, "the slow lamp off", |_, inputs| {
        inputs.digital == 0b01
    });
}

#[test]
fn servers_that_answer_in_time_are_waited_for_and_have_quality() {
    let (a, b) = (start_at("127.0.0.1:0"), start_at("127.0.0.1:0"));
    let mut driver = open([&a, &b], "1 s");
    let mut exchanges = 0;
    until(
        &mut driver,
        &BOTH_ON,
        "a quality",
        |result, _| match result {
            Ok(exchange) => {
                exchanges += 1;
                exchanges > 100 && exchange.quality_permille > 500
            }
            Err(_) => false,
        },
    );
}

#[test]
fn faults_of_a_server_are_named_and_end_with_it() {
    let (a, mut b) = (start_at("127.0.0.1:0"), start_at("127.0.0.1:0"));
    let mut driver = open([&a, &b], "100 ms");
    let reasons = driver.reasons().expect("servers with names");
    for (fault, reason) in [
        (r#"{"exception":4}"#, 2 * NAMED + EXCEPTIONS + 4),
        (r#"{"exception":6}"#, 2 * NAMED + EXCEPTIONS + 6),
        (r#"{"drop":3}"#, 2 * NAMED + TIMEOUT),
        (r#"{"delay_ms":300}"#, 2 * NAMED + TIMEOUT),
    ] {
        both_on(&mut driver);
        assert_eq!(b.ask(fault)["ok"], true);
        lost_by(&mut driver, &[reason]);
        let words = reasons
            .iter()
            .find(|row| row.0 == reason)
            .expect("its words")
            .1;
        assert!(words.starts_with("server 'b': "), "{words}");
        assert_eq!(b.ask(r#"{"clear":null}"#)["ok"], true);
    }
    both_on(&mut driver);
    assert!(b.ask(r#"{"exception":7}"#)["error"].is_string());
}

#[test]
fn the_last_outputs_leave_before_a_driver_ends() {
    let (mut a, mut b) = (start_at("127.0.0.1:0"), start_at("127.0.0.1:0"));
    let mut driver = open([&a, &b], "1 s");
    both_on(&mut driver);
    driver
        .send(&Outputs {
            digital: 0,
            ..BOTH_ON
        })
        .unwrap();
    drop(driver);
    assert_eq!(a.state()["coils"][0], false);
    assert_eq!(b.state()["coils"][0], false);
}

#[test]
fn the_cell_of_the_documentation_is_right_and_its_device_goes_online() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/cells/modbus.yaml");
    let cell = CellConfig::load_offline(&path).unwrap_or_else(|faults| panic!("{faults}"));
    let mut device = cell.devices[0].clone();
    let simulators: Vec<Simulator> = cell
        .simulators
        .iter()
        .map(|simulator| {
            let wires = simulator
                .arguments
                .iter()
                .filter(|argument| argument.starts_with("--wire"));
            start(&wires.map(String::as_str).collect::<Vec<_>>())
        })
        .collect();
    for (name, simulator) in ["press", "oven"].into_iter().zip(&simulators) {
        device.settings["servers"][name]["address"] = simulator.modbus().to_string().into();
        device.settings["servers"][name]["timeout"] = "2 s".into();
    }
    let mut driver = Modbus::open(&device).unwrap();
    let mut outputs = Outputs {
        digital: 0b11,
        digital_set: 0b11,
        ..Outputs::NONE
    };
    outputs.analog[..2].copy_from_slice(&[1234.5, 300.15]);
    until(&mut driver, &outputs, "the force", |result, inputs| {
        result.is_ok() && inputs.digital & 1 == 1 && inputs.analog[0] == 1234.5
    });
    let mut oven = simulators.into_iter().nth(1).unwrap();
    let state = oven.state();
    assert_eq!(
        (&state["holding"][7], &state["holding"][10]),
        (&json!(4), &json!(270))
    );
}
