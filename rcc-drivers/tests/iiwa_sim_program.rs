//! The program `iiwa-sim` on real sockets: it sends first, can be commanded, survives a client that goes and comes, and ends on
//! request.
//! Runs in the test harness; the system chooses the ports.

mod common;

use common::Simulator;
use rcc_drivers::fri_iiwa::wire::schema::{Command, CommandData, Header, Monitoring};
use rcc_drivers::fri_iiwa::wire::{COMMAND_ID, Version, decode, encode};
use rcc_drivers::sim::trace::TraceRecord;
use serde_json::json;
use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::process::Command as Process;
use std::time::Duration;

const PROGRAM: &str = env!("CARGO_BIN_EXE_iiwa-sim");

fn start(client: &UdpSocket, fri: &str, more: &[&str]) -> Simulator {
    let driver = client.local_addr().unwrap().to_string();
    let fri = format!("--fri={fri}");
    let start = "--start=0,0.5,0,-1.5625,0,1,0";
    let arguments = ["--driver", &driver, "--period-ms", "5", &fri, start];
    Simulator::start(PROGRAM, &[&arguments[..], more].concat())
}

fn client() -> UdpSocket {
    bound("127.0.0.1:0")
}

fn bound(address: &str) -> UdpSocket {
    let socket = UdpSocket::bind(address).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    socket
}

/// Answers one message by mirroring; returns it.
fn mirror(client: &UdpSocket, version: Version, sequence: u32) -> (Monitoring, SocketAddr) {
    let mut bytes = [0; 2048];
    let (length, source) = client.recv_from(&mut bytes).expect("the robot sends");
    let seen: Monitoring = decode(version, &bytes[..length]).unwrap();
    let command = Command {
        header: Some(Header {
            identifier: Some(COMMAND_ID),
            sequence: Some(sequence),
            reflected: seen.header.unwrap().sequence,
        }),
        data: seen.interpolator.as_ref().map(|own| CommandData {
            position: own.position.clone(),
            ..CommandData::default()
        }),
        end: None,
    };
    client
        .send_to(&encode(version, &command).unwrap(), source)
        .unwrap();
    (seen, source)
}

fn session(seen: &Monitoring) -> i32 {
    seen.connection.unwrap().session.unwrap()
}

/// Mirrors until commands are executed; returns the number of answers.
fn commanding(client: &UdpSocket, version: Version) -> u32 {
    let mut sequence = 0..;
    let entered = sequence.find(|sequence| session(&mirror(client, version, *sequence).0) == 4);
    entered.unwrap()
}

#[test]
fn a_client_that_mirrors_gets_commands_executed_and_finds_its_answers_in_the_trace() {
    for (fri, version) in [("1.15", Version::V1_14), ("2.7", Version::V2_7)] {
        let client = client();
        let folder = rcc_testing::folder();
        let trace = folder.path().join("trace.csv");
        let trace_option = trace.to_str().unwrap();
        let mut simulator = start(
            &client,
            fri,
            &[
                "--quality=0.5,0.3,0.1",
                "--bridge=100",
                "--trace",
                trace_option,
            ],
        );
        commanding(&client, version);
        assert_eq!(simulator.ask(r#"{"flush":null}"#), json!({"ok": true}));
        let text = fs::read_to_string(&trace).unwrap();
        let records = text
            .lines()
            .skip(1)
            .map(|line| TraceRecord::parse(line).unwrap());
        let commanded = -1.5625;
        let mut found = records.filter(|record| record.answered && record.state >= 3);
        assert!(found.any(|record| record.commanded[3] == commanded));
        let state = simulator.state();
        assert_eq!(state["session"], "commanding-active");
        assert_eq!(simulator.ask("\"quit\""), json!({"ok": true}));
        assert!(simulator.child.wait().unwrap().success());
    }
}

#[test]
fn a_client_may_go_and_come_back_and_the_session_too() {
    let client = client();
    let version = Version::V2_5;
    let mut simulator = start(&client, "2.5", &["--quality=0.5,0.3,0.1", "--bridge=5"]);
    commanding(&client, version);
    // Nobody answers: the motion ends, and the robot goes on sending.
    let mut bytes = [0; 2048];
    loop {
        let (length, _) = client.recv_from(&mut bytes).expect("the robot goes on");
        let seen: Monitoring = decode(version, &bytes[..length]).unwrap();
        if session(&seen) < 3 {
            break;
        }
    }
    // A new client counts from 0.
    commanding(&client, version);
    assert_eq!(
        simulator.ask(r#"{"session":{"open":false}}"#),
        json!({"ok": true})
    );
    while session(&mirror(&client, version, u32::MAX / 4).0) != 0 {}
    assert_eq!(
        simulator.ask(r#"{"session":{"open":true}}"#),
        json!({"ok": true})
    );
    commanding(&client, version);
}

#[test]
fn a_client_that_exits_in_idle_may_come_back_as_another_process_would() {
    // An address that other tests do not use: the port stays free while nobody listens.
    let first = bound("127.0.0.5:0");
    let address = first.local_addr().unwrap().to_string();
    let version = Version::V1_14;
    let mut simulator = start(&first, "1.15", &["--quality=0.5,0.3,0.1", "--bridge=5"]);
    commanding(&first, version);
    assert_eq!(
        simulator.ask(r#"{"session":{"open":false}}"#),
        json!({"ok": true})
    );
    while session(&mirror(&first, version, u32::MAX / 4).0) != 0 {}
    drop(first);
    simulator.await_state("the last message", |state| state["session"] == "idle");
    assert_eq!(
        simulator.ask(r#"{"session":{"open":true}}"#),
        json!({"ok": true})
    );
    let sent = simulator.state()["counts"]["sent"].as_u64().unwrap();
    simulator.await_state("messages to nobody", |state| {
        state["counts"]["sent"].as_u64() > Some(sent + 20)
    });
    commanding(&bound(&address), version);
    let state = simulator.state();
    assert!(state["counts"]["entries"].as_u64() >= Some(2), "{state}");
}

#[test]
fn client_and_robot_may_have_the_same_port_on_two_loopback_addresses() {
    let socket = client();
    let port = socket.local_addr().unwrap().port();
    let bind = format!("--bind=127.0.0.2:{port}");
    let _simulator = start(&socket, "1.11", &[&bind]);
    let (_, source) = mirror(&socket, Version::V1_11, 0);
    assert_eq!(source, SocketAddr::from(([127, 0, 0, 2], port)));
}

#[test]
fn invalid_options_are_a_usage_error_that_names_the_option() {
    for (more, words) in [
        (&["--overlay=torque"][..], "--overlay"),
        (
            &["--io=A.b=boolean:input", "--io=A.b=boolean:input"],
            "--io",
        ),
        (&["--bandwidth=0"], "--bandwidth"),
        (&["--period-ms=0"], "--period-ms"),
    ] {
        let output = Process::new(PROGRAM)
            .args(["--driver=127.0.0.1:1", "--fri=1.15"])
            .args(more)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains(words), "{text}");
    }
}
