//! The program `lwr-sim` on real sockets: it sends first, can be commanded, and ends on request.
//! Runs in the test harness; the system chooses the ports.

mod common;

use common::Folder;
use rcc_drivers::fri_lwr::wire::{CommandDatagram, MeasurementDatagram, SessionState, flags};
use rcc_drivers::sim::line_server::ControlClient;
use rcc_drivers::sim::lwr::trace::TraceRecord;
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A running simulator; killed if the test ends first.
struct Simulator {
    child: Child,
    control: ControlClient,
    folder: Folder,
}

impl Simulator {
    fn start(driver: &UdpSocket, more: &[&str]) -> Self {
        let folder = Folder::new();
        let mut child = Command::new(env!("CARGO_BIN_EXE_lwr-sim"))
            .arg("--control")
            .arg(folder.socket())
            .args(["--driver", &driver.local_addr().unwrap().to_string()])
            .args([
                "--parent-death",
                "--period-ms",
                "5",
                "--start",
                "0,0.5,0,-1.25,0,1,0",
            ])
            .args(more)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let told = line.trim().rsplit_once("control=");
        let (_, told) = told.expect("a line with the places");
        assert_eq!(Path::new(told), folder.socket());
        let control = ControlClient::connect(told).unwrap();
        Self {
            child,
            control,
            folder,
        }
    }

    fn ask(&mut self, request: &str) -> Value {
        serde_json::from_str(&self.control.ask(request).unwrap()).unwrap()
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

struct Trace(PathBuf);

impl Drop for Trace {
    fn drop(&mut self) {
        // It may not have been written.
        let _ = std::fs::remove_file(&self.0);
    }
}

fn pc() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    socket
}

/// Answers one datagram by mirroring; returns the datagram.
fn mirror(pc: &UdpSocket, sequence: u16) -> MeasurementDatagram {
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
    seen
}

#[test]
fn a_pc_that_mirrors_gets_into_command_state_and_finds_its_answers_in_the_trace() {
    let pc = pc();
    let trace = Trace(std::env::temp_dir().join(format!("rcc-lwr-sim-{}.csv", std::process::id())));
    let mut simulator = Simulator::start(&pc, &["--trace", trace.0.to_str().unwrap()]);
    // A stall of this machine may cost the command state again: this number of cycles is ample.
    let commanded =
        (1..20_000).any(|sequence| mirror(&pc, sequence).state == SessionState::Command);
    assert!(commanded);
    let state = simulator.ask(r#"{"state":null}"#);
    assert!(
        state["counts"]["answered"].as_u64().unwrap() > 50,
        "{state}"
    );
    assert_eq!(state["q"][3], -1.25);
    assert_eq!(simulator.ask(r#"{"flush":null}"#)["ok"], true);
    let text = std::fs::read_to_string(&trace.0).unwrap();
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
fn requests_write_files_below_the_folder_of_the_socket_only() {
    let pc = pc();
    let mut simulator = Simulator::start(&pc, &[]);
    let elsewhere = Folder::new();
    let folder = simulator.folder.0.clone();
    let outside = elsewhere.0.join("trace.csv");
    symlink(&elsewhere.0, folder.join("way")).unwrap();
    symlink(&outside, folder.join("link.csv")).unwrap();
    let name = elsewhere.0.file_name().unwrap().to_str().unwrap();
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
    assert_eq!(fs::read_dir(&elsewhere.0).unwrap().count(), 0);
}

#[test]
fn a_termination_signal_ends_it_without_an_error() {
    let pc = pc();
    let mut simulator = Simulator::start(&pc, &[]);
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
