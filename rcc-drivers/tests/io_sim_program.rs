//! The program `io-sim` on real sockets: a Modbus client reads back what it wrote, and sees inputs set by hand.
//! Runs in the test harness; ports are chosen by the system.

use rcc_drivers::sim::lines::Client;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use tokio_modbus::ExceptionCode;
use tokio_modbus::client::{Reader, Writer, tcp};

/// A running simulator; killed if the test ends before it does.
struct Simulator {
    child: Child,
    modbus: SocketAddr,
    control: Client,
    at: SocketAddr,
}

impl Simulator {
    fn start(more: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_io-sim"))
            .arg("--parent-death")
            .args(more)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let address = |name: &str| -> SocketAddr {
            line.split_whitespace()
                .find_map(|part| part.strip_prefix(name))
                .unwrap()
                .parse()
                .unwrap()
        };
        let control = Client::connect(address("control=")).unwrap();
        Self {
            modbus: address("modbus="),
            child,
            control,
            at: address("control="),
        }
    }

    fn ask(&mut self, request: &str) -> Value {
        serde_json::from_str(&self.control.ask(request).unwrap()).unwrap()
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // it may have ended already
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[tokio::test]
async fn outputs_reach_wired_inputs_and_inputs_can_be_set_by_hand() {
    let mut simulator =
        Simulator::start(&["--wire", "coil:2=discrete:7", "--wire", "holding:0=input:1"]);
    let mut client = tcp::connect(simulator.modbus).await.unwrap();
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
    let state = simulator.ask(r#"{"state":null}"#);
    assert_eq!(
        (&state["coils"][2], &state["holding"][0]),
        (&Value::Bool(true), &Value::from(1234))
    );
    assert_eq!(simulator.ask(r#"{"quit":null}"#)["ok"], true);
    assert!(simulator.child.wait().unwrap().success());
}

/// The simulator is ours, and nobody is a program of another user.
#[test]
fn another_user_cannot_command_it() {
    if !nix::unistd::getuid().is_root() {
        return eprintln!(
            "skipped: another_user_cannot_command_it (it takes root to be somebody else)"
        );
    }
    // A simulator of root's admits nobody but root.
    let mut simulator = Simulator::start(&[]);
    let script = format!(
        "exec 3<>/dev/tcp/127.0.0.1/{}; echo '{{\"state\":null}}' >&3; head -n 1 <&3",
        simulator.at.port()
    );
    let ask = |user: &str| {
        let output = Command::new("setpriv")
            .args([
                "--reuid",
                user,
                "--clear-groups",
                "timeout",
                "10",
                "bash",
                "-c",
                &script,
            ])
            .output()
            .unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let answer = ask("65534");
    assert!(
        answer.contains("user 65534 may not command this simulator") && !answer.contains("coils"),
        "{answer}"
    );
    assert!(ask("0").contains("coils"));
    assert!(simulator.ask(r#"{"state":null}"#)["coils"].is_array());
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
            .contains("is no wire")
    );
}
