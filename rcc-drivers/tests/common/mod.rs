//! A simulator with a control socket in a folder of its own.
//! Runs in the test harness.
#![allow(dead_code)] // Each test program uses a part of it.

use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use rcc_drivers::sim::line_server::ControlClient;
use rcc_testing::TempDir;
use serde_json::Value;

/// A running simulator; killed if the test ends first.
pub struct Simulator {
    pub child: Child,
    pub folder: TempDir,
    /// Line that it printed once it was ready.
    pub line: String,
    control: ControlClient,
}

impl Simulator {
    /// Starts the program and waits until it is ready.
    pub fn start(program: &str, arguments: &[&str]) -> Self {
        let folder = rcc_testing::folder();
        let socket = folder.path().join("sim.sock");
        let mut child = Command::new(program)
            .arg("--parent-death")
            .arg("--control")
            .arg(&socket)
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        Self {
            control: ControlClient::connect(socket).unwrap(),
            child,
            folder,
            line,
        }
    }

    /// Returns the path of the control socket.
    pub fn socket(&self) -> PathBuf {
        self.folder.path().join("sim.sock")
    }

    /// Returns the address at which it serves Modbus.
    pub fn modbus(&self) -> SocketAddr {
        let mut words = self.line.split_whitespace();
        let address = words.find_map(|word| word.strip_prefix("modbus="));
        address.unwrap().parse().unwrap()
    }

    pub fn ask(&mut self, request: &str) -> Value {
        serde_json::from_str(&self.control.ask(request).unwrap()).unwrap()
    }

    pub fn state(&mut self) -> Value {
        self.ask(r#"{"state":null}"#)
    }

    /// Asks for the state, each time once per tick, until it is as `wanted`.
    pub fn await_state(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let mut state = Value::Null;
        for _ in 0..10_000 {
            state = self.state();
            if wanted(&state) {
                return state;
            }
        }
        panic!("{what}: {state}");
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
