//! The dashboard of a test cell (`rcc-monitor serve`) and a page that reads its stream, over plain TCP as a browser would.
//! Runs on the threads of the test harness and of measuring programs.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

use nix::sys::signal::Signal;
use serde_json::Value;

use crate::cell_fixture::CellFixture;
use crate::processes::{ends_with_test, signal};
use crate::waiting::LIMIT;

/// A running dashboard; it is killed when this is dropped.
#[derive(Debug)]
pub struct DashboardServer {
    child: Child,
    port: u16,
    token: String,
}

/// An answer.
#[derive(Clone, Debug)]
pub struct PageReply {
    /// HTTP status code.
    pub status: u16,
    /// The head's lines.
    pub head: String,
    /// The body as text.
    pub body: String,
}

impl PageReply {
    /// The body as JSON; null if it is not JSON.
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_default()
    }
}

/// The stream of one page.
#[derive(Debug)]
pub struct PageStream {
    lines: BufReader<TcpStream>,
    /// Number that the server gave the page.
    pub viewer: u64,
}

fn connect(port: u16) -> io::Result<TcpStream> {
    let stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_read_timeout(Some(LIMIT))?;
    Ok(stream)
}

/// Sends a request with these header lines to the dashboard at this port of 127.0.0.1 and reads the whole answer.
pub fn request(port: u16, (method, path): (&str, &str), lines: &str, body: &str) -> PageReply {
    let mut stream = connect(port).expect("the dashboard listens");
    let head = format!(
        "{method} {path} HTTP/1.1\r\nconnection: close\r\ncontent-type: application/json\r\n{lines}content-length: {}\r\n\r\n{body}",
        body.len()
    );
    stream
        .write_all(head.as_bytes())
        .expect("the request is sent");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("an answer");
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    let status = head
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    PageReply {
        status: status.expect("a status"),
        head: head.to_lowercase(),
        body: body.to_owned(),
    }
}

impl DashboardServer {
    /// Starts the dashboard of a cell on any free port and waits for its address.
    pub fn start(cell: &CellFixture, arguments: &[&str]) -> DashboardServer {
        let mut command = cell.program("rcc-monitor");
        command.args(["serve", "--port", "0"]).args(arguments);
        let command = ends_with_test(&mut command).stdout(Stdio::piped());
        let mut child = command.spawn().expect("rcc-monitor starts");
        let mut address = String::new();
        let output = child.stdout.take().expect("a pipe");
        BufReader::new(output)
            .read_line(&mut address)
            .expect("an address");
        let parts = address.trim().strip_prefix("http://127.0.0.1:");
        let (port, token) = parts
            .and_then(|rest| rest.split_once("/?token="))
            .expect("an address with a token");
        DashboardServer {
            child,
            port: port.parse().expect("a port"),
            token: token.to_owned(),
        }
    }

    /// Its port on 127.0.0.1.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Its token.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// The header lines of its own page: host, origin, cookie.
    pub fn own_lines(&self) -> String {
        let (port, token) = (self.port, &self.token);
        format!(
            "host: 127.0.0.1:{port}\r\norigin: http://127.0.0.1:{port}\r\ncookie: rcc-dashboard-{port}={token}\r\n"
        )
    }

    /// Sends a request with these header lines and reads the whole answer.
    pub fn request(&self, method: &str, path: &str, lines: &str, body: &str) -> PageReply {
        request(self.port, (method, path), lines, body)
    }

    /// Sends a request of its own page.
    pub fn own(&self, method: &str, path: &str, body: &str) -> PageReply {
        self.request(method, path, &self.own_lines(), body)
    }

    /// Opens the stream of a page.
    pub fn open(&self) -> PageStream {
        let mut stream = connect(self.port).expect("the dashboard listens");
        let head = format!("GET /api/stream HTTP/1.1\r\n{}\r\n", self.own_lines());
        stream
            .write_all(head.as_bytes())
            .expect("the request is sent");
        let mut page = PageStream {
            lines: BufReader::new(stream),
            viewer: 0,
        };
        page.viewer = page.next("hello")["viewer"].as_u64().expect("a number");
        page
    }

    /// Watches ports for a page.
    pub fn watch(&self, page: &PageStream, ports: &[&str], rate: f64) {
        let body = serde_json::json!({"ports": ports, "rate": rate, "arms": false});
        let reply = self.own(
            "POST",
            &format!("/api/viewers/{}/watch", page.viewer),
            &body.to_string(),
        );
        assert_eq!(reply.status, 200, "{reply:?}");
    }

    /// Ends it as Ctrl-C does and returns its exit code.
    pub fn interrupt(mut self) -> Option<i32> {
        signal(self.child.id(), Signal::SIGINT);
        self.child.wait().expect("it is a child").code()
    }
}

impl Drop for DashboardServer {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl PageStream {
    /// Returns name and data of the next event.
    pub fn next_event(&mut self) -> (String, Value) {
        let (mut event, mut data) = (String::new(), None);
        loop {
            let mut line = String::new();
            let read = self
                .lines
                .read_line(&mut line)
                .expect("the stream can be read");
            assert!(read > 0, "the stream ended");
            let line = line.trim_end();
            if let Some(name) = line.strip_prefix("event: ") {
                event = name.to_owned();
            } else if let Some(text) = line.strip_prefix("data: ") {
                data = Some(serde_json::from_str(text).expect("JSON"));
            } else if let (true, Some(data)) = (line.is_empty(), data.take()) {
                return (event, data);
            }
        }
    }

    /// Returns the data of the next event of this name.
    pub fn next(&mut self, name: &str) -> Value {
        self.find(name, |data| Some(data.clone()))
    }

    /// Returns what `wanted` finds in an event of this name.
    pub fn find<T>(&mut self, name: &str, mut wanted: impl FnMut(&Value) -> Option<T>) -> T {
        loop {
            let (event, data) = self.next_event();
            if event == name
                && let Some(found) = wanted(&data)
            {
                return found;
            }
        }
    }
}
