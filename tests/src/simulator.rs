//! The control port of a simulator: one JSON object a line, each way.

use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Duration;

use serde_json::Value;

/// A connection to the control port of `lwr-sim` or `io-sim`.
#[derive(Debug)]
pub struct Simulator {
    stream: BufReader<TcpStream>,
}

impl Simulator {
    /// Connects; the simulator must be running.
    pub fn connect(port: u16) -> Simulator {
        let stream =
            TcpStream::connect((Ipv4Addr::LOCALHOST, port)).expect("the simulator listens");
        stream
            .set_read_timeout(Some(Duration::from_secs(10)))
            .expect("a time-out can be set");
        Simulator {
            stream: BufReader::new(stream),
        }
    }

    /// Sends one request and returns its answer.
    pub fn ask(&mut self, request: &Value) -> Value {
        let mut line = request.to_string();
        line.push('\n');
        self.stream
            .get_mut()
            .write_all(line.as_bytes())
            .expect("the simulator reads");
        let mut answer = String::new();
        self.stream
            .read_line(&mut answer)
            .expect("the simulator answers");
        serde_json::from_str(&answer)
            .unwrap_or_else(|error| panic!("{request}: {answer:?}: {error}"))
    }
}
