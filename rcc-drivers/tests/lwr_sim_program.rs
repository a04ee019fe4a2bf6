//! The program `lwr-sim` on real sockets: it sends first, can be commanded, and ends on request.
//! Runs in the test harness; the system chooses the ports.

mod common;

use common::Simulator;
use rcc_drivers::fri_lwr::wire::{CommandDatagram, MeasurementDatagram, SessionState, flags};
use rcc_drivers::sim::trace::TraceRecord;
use serde_json::json;
use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

fn start(driver: &UdpSocket, more: &[&str]) -> Simulator {
    let driver = driver.local_addr().unwrap().to_string();
    let arguments = ["--driver", &driver, "--period-ms", "5"];
    let start = ["--start", "0,0.5,0,-1.25,0,1,0"];
    let arguments = [&arguments[..], &start, more].concat();
    let simulator = Simulator::start(env!("CARGO_BIN_EXE_lwr-sim"), &arguments);
    let told = simulator.line.trim().rsplit_once("control=");
    let (_, told) = told.expect("a line with the places");
    assert_eq!(Path::new(told), simulator.socket());
    simulator
}

fn pc() -> UdpSocket {
    bound("127.0.0.1:0")
}

fn bound(address: &str) -> UdpSocket {
    let socket = UdpSocket::bind(address).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    socket
}

/// Answers one datagram by mirroring; returns the datagram.
fn mirror(pc: &UdpSocket, sequence: u16) -> MeasurementDatagram {
    mirror_to(pc, sequence).0
}

/// As [`mirror`]; returns the address of the controller, too.
fn mirror_to(pc: &UdpSocket, sequence: u16) -> (MeasurementDatagram, SocketAddr) {
    let mut bytes = [0; 2048];
    let (length, source) = pc.recv_from(&mut bytes).expect("the controller sends");
    let seen = MeasurementDatagram::decode(&bytes[..length]).unwrap();
    let mut answer = CommandDatagram {
        send_sequence: sequence,
        reflected_sequence: seen.send_sequence,
        flags: flags::JOINT_POSITION,
        ..CommandDatagram::default()
    };
    answer.krl.integers[0] = 1;
    for (joint, position) in answer.joint_position.iter_mut().enumerate() {
        *position = seen.commanded_position[joint] + seen.commanded_position_offset[joint];
    }
    pc.send_to(&answer.encode(), source).unwrap();
    (seen, source)
}

/// Mirrors, with a counter from 1, until command state.
fn commanding(pc: &UdpSocket) {
    // A stall of this machine may cost the command state again: this number of cycles is ample.
    let commanded = (1..20_000).any(|sequence| mirror(pc, sequence).state == SessionState::Command);
    assert!(commanded);
}

#[test]
fn a_pc_that_mirrors_gets_into_command_state_and_finds_its_answers_in_the_trace() {
    let pc = pc();
    let folder = rcc_testing::folder();
    let trace = folder.path().join("trace.csv");
    let mut simulator = start(&pc, &["--trace", trace.to_str().unwrap()]);
    commanding(&pc);
    let state = simulator.state();
    assert!(
        state["counts"]["answered"].as_u64().unwrap() > 50,
        "{state}"
    );
    assert_eq!(state["q"][3], -1.25);
    assert_eq!(simulator.ask(r#"{"flush":null}"#)["ok"], true);
    let text = std::fs::read_to_string(&trace).unwrap();
    let records: Vec<TraceRecord> = text
        .lines()
        .skip(1)
        .map(|line| TraceRecord::parse(line).unwrap())
        .collect();
    assert!(
        records
            .iter()
            .any(|record| record.answered && record.commanded[3] == -1.25)
    );
    assert!(
        records
            .windows(2)
            .all(|pair| pair[1].tick == pair[0].tick + 1)
    );
    assert!(simulator.ask("nonsense")["error"].is_string());
    assert_eq!(simulator.ask(r#"{"quit":null}"#)["ok"], true);
    assert!(simulator.child.wait().unwrap().success());
}

#[test]
fn a_pc_may_exit_and_come_back_with_a_counter_of_its_own() {
    // An address that other tests do not use: the port stays free while nobody listens.
    let first = bound("127.0.0.4:0");
    let address = first.local_addr().unwrap().to_string();
    let mut simulator = start(&first, &["--quality=0.5,0.3,0.1"]);
    commanding(&first);
    drop(first);
    simulator.await_state("monitor state", |state| state["fri_state"] == "monitor");
    let sent = simulator.state()["counts"]["sent"].as_u64().unwrap();
    simulator.await_state("datagrams to nobody", |state| {
        state["counts"]["sent"].as_u64() > Some(sent + 20)
    });
    commanding(&bound(&address));
    let state = simulator.state();
    assert!(state["counts"]["entries"].as_u64() >= Some(2), "{state}");
}

#[test]
fn pc_and_controller_may_have_the_same_port_on_two_loopback_addresses() {
    let pc = pc();
    let port = pc.local_addr().unwrap().port();
    let bind = format!("--bind=127.0.0.2:{port}");
    let _simulator = start(&pc, &[&bind]);
    let (_, source) = mirror_to(&pc, 1);
    assert_eq!(source, SocketAddr::from(([127, 0, 0, 2], port)));
}

#[test]
fn what_is_not_taken_is_counted_and_told_in_the_state() {
    let pc = pc();
    let mut simulator = start(&pc, &[]);
    let (_, source) = mirror_to(&pc, 1);
    pc.send_to(&[0; 375], source).unwrap();
    let state = simulator.await_state("a refusal", |state| state["counts"]["refused"] == 1);
    let told = state["last_refusal"].as_str().unwrap_or_default();
    assert!(told.contains("received 375 bytes, expected 376"), "{state}");
    assert_eq!(state["counts"]["wrong_size"], 1, "{state}");
}

#[test]
fn requests_write_files_below_the_folder_of_the_socket_only() {
    let pc = pc();
    let mut simulator = start(&pc, &[]);
    let temporary = rcc_testing::folder();
    let elsewhere = temporary.path();
    let folder = simulator.folder.path().to_owned();
    let outside = elsewhere.join("trace.csv");
    symlink(elsewhere, folder.join("way")).unwrap();
    symlink(&outside, folder.join("link.csv")).unwrap();
    let name = elsewhere.file_name().unwrap().to_str().unwrap();
    let up = format!("../{name}/trace.csv");
    for (path, part) in [
        (outside.to_str().unwrap(), "is not below"),
        (up.as_str(), "is not below"),
        ("way/trace.csv", "is not below"),
        ("link.csv", "is a symbolic link"),
    ] {
        let answer = simulator.ask(&json!({"trace": {"path": path}}).to_string());
        let words = answer["error"].as_str().unwrap_or_default();
        assert!(words.contains(part), "{path}: {answer}");
        assert!(!outside.exists(), "{path}");
    }
    let within = folder.join("whole.csv");
    for path in [Path::new("trace.csv"), &within] {
        let answer = simulator.ask(&json!({"trace": {"path": path}}).to_string());
        assert_eq!(answer["ok"], true, "{answer}");
        assert!(folder.join(path).exists());
    }
    assert_eq!(fs::read_dir(elsewhere).unwrap().count(), 0);
}

#[test]
fn a_termination_signal_ends_it_without_an_error() {
    let pc = pc();
    let mut simulator = start(&pc, &[]);
    mirror(&pc, 1);
    let id = i32::try_from(simulator.child.id()).unwrap();
    nix::sys::signal::kill(
        nix::unistd::Pid::from_raw(id),
        nix::sys::signal::Signal::SIGTERM,
    )
    .unwrap();
    assert!(simulator.child.wait().unwrap().success());
}

#[test]
fn impossible_options_are_refused_with_a_sentence_and_exit_code_2() {
    let output = Command::new(env!("CARGO_BIN_EXE_lwr-sim"))
        .args(["--driver", "127.0.0.1:1", "--safety-limits", "7"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(
        text.contains("invalid value 7 for --safety-limits") && text.contains("at most 1"),
        "{text}"
    );
}
