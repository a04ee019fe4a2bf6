//! The program `io-sim` on real sockets: a Modbus client reads back what it wrote, and reads inputs set through the
//! control port.
//! Runs in the test harness; the system chooses the ports.

mod common;

use common::Simulator;
use rcc_drivers::sim::line_server::ControlClient;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, ErrorKind};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};
use tokio_modbus::ExceptionCode;
use tokio_modbus::client::{Reader, Writer, tcp};

fn start(arguments: &[&str]) -> Simulator {
    Simulator::start(env!("CARGO_BIN_EXE_io-sim"), arguments)
}

#[tokio::test]
async fn outputs_reach_wired_inputs_and_inputs_can_be_set_by_hand() {
    let mut simulator = start(&["--wire", "coil:2=discrete:7", "--wire", "holding:0=input:1"]);
    let mut client = tcp::connect(simulator.modbus()).await.unwrap();
    client.write_single_coil(2, true).await.unwrap().unwrap();
    client
        .write_multiple_registers(0, &[1234])
        .await
        .unwrap()
        .unwrap();
    assert_eq!(
        client.read_discrete_inputs(7, 1).await.unwrap().unwrap(),
        [true]
    );
    assert_eq!(
        client.read_input_registers(1, 1).await.unwrap().unwrap(),
        [1234]
    );
    assert_eq!(
        simulator.ask(r#"{"set":{"discrete":{"address":0,"value":true}}}"#)["ok"],
        true
    );
    assert_eq!(simulator.ask(r#"{"freeze_ms":1}"#)["ok"], true);
    assert_eq!(
        client.read_discrete_inputs(0, 1).await.unwrap().unwrap(),
        [true]
    );
    assert_eq!(
        client.read_coils(60, 5).await.unwrap(),
        Err(ExceptionCode::IllegalDataAddress)
    );
    let state = simulator.state();
    assert_eq!(
        (&state["coils"][2], &state["holding"][0]),
        (&Value::Bool(true), &Value::from(1234))
    );
    assert_eq!(simulator.ask(r#"{"quit":null}"#)["ok"], true);
    assert!(simulator.child.wait().unwrap().success());
}

#[test]
fn another_user_cannot_command_it() {
    let mut simulator = start(&[]);
    let socket = simulator.socket();
    let mode = fs::metadata(&socket).unwrap().mode() & 0o777;
    assert_eq!(mode, 0o600);
    if !nix::unistd::getuid().is_root() {
        return eprintln!(
            "skipped: another_user_cannot_command_it (it takes root to be somebody else)"
        );
    }
    // The socket's own mode is decisive: a group may have access to the folder of a cell.
    fs::set_permissions(simulator.folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let connect_as = |user: u32| {
        let socket = socket.clone();
        // Affects only this thread, and drops root's file privileges (setfsuid(2), capabilities(7)).
        let connect = move || {
            nix::unistd::setfsuid(nix::unistd::Uid::from_raw(user));
            UnixStream::connect(socket).map_err(|error| error.kind())
        };
        std::thread::spawn(connect).join().unwrap()
    };
    let theirs = connect_as(65534).map(|_| ());
    assert_eq!(theirs, Err(ErrorKind::PermissionDenied));
    assert!(connect_as(0).is_ok());
    assert!(simulator.state()["coils"].is_array());
}

#[test]
fn a_dead_simulators_socket_is_replaced_and_an_ended_one_leaves_none() {
    let mut simulator = start(&[]);
    simulator.child.kill().unwrap();
    simulator.child.wait().unwrap();
    let socket = simulator.socket();
    assert!(socket.exists(), "it could not remove it");
    let mut next = Command::new(env!("CARGO_BIN_EXE_io-sim"))
        .args(["--parent-death", "--control"])
        .arg(&socket)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let stdout = next.stdout.take().unwrap();
    BufReader::new(stdout).read_line(&mut line).unwrap();
    let mut control = ControlClient::connect(&socket).unwrap();
    // A second simulator is refused while the first one runs.
    let refused = Command::new(env!("CARGO_BIN_EXE_io-sim"))
        .arg("--control")
        .arg(&socket)
        .output()
        .unwrap();
    let words = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{words}");
    assert!(words.contains("another simulator listens there"), "{words}");
    assert!(control.ask("\"quit\"").unwrap().contains("ok"));
    assert!(next.wait().unwrap().success());
    assert!(!socket.exists());
}

#[test]
fn the_address_of_older_versions_is_refused_with_the_remedy() {
    let output = Command::new(env!("CARGO_BIN_EXE_io-sim"))
        .arg("--control=127.0.0.1:0")
        .output()
        .unwrap();
    let words = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(words.contains("Unix socket: give the path"), "{words}");
}

#[test]
fn a_wire_that_cannot_be_is_refused_with_exit_code_2() {
    let output = Command::new(env!("CARGO_BIN_EXE_io-sim"))
        .args(["--wire", "coil:0=input:0"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(
        String::from_utf8(output.stderr)
            .unwrap()
            .contains("invalid loopback")
    );
}
