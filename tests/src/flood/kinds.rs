//! The kinds of floods. Run by dedicated processes until they are killed.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::Duration;

use super::report::Interface;
use super::{Interfaces, connect, net};
use crate::rest;

/// Threads of a flooding process.
const THREADS: usize = 4;
/// Connections of each interface that a thread holds open without sending anything.
const SILENT: usize = 100;

/// A kind of flood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FloodKind {
    /// Loads texts of 4 MiB that are rejected, and unloads them.
    Rejected,
    /// Sends JSON bodies of 4 MiB to routes that accept a body and to routes that do not.
    Json,
    /// Opens connections and sends nothing.
    Silent,
    /// Sends headers and bodies byte by byte.
    Slow,
    /// Sends invalid tokens over TCP.
    WrongTokens,
    /// Reads lists, details, values and the status over both transports.
    Looks,
    /// Loads and unloads large nets.
    Loads,
    /// Sends bytes that are not HTTP.
    Nonsense,
}

impl FloodKind {
    /// Every kind.
    pub const ALL: [FloodKind; 8] = [
        FloodKind::Rejected,
        FloodKind::Json,
        FloodKind::Silent,
        FloodKind::Slow,
        FloodKind::WrongTokens,
        FloodKind::Looks,
        FloodKind::Loads,
        FloodKind::Nonsense,
    ];

    /// Returns the name used on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            FloodKind::Rejected => "rejected",
            FloodKind::Json => "json",
            FloodKind::Silent => "silent",
            FloodKind::Slow => "slow",
            FloodKind::WrongTokens => "wrong-tokens",
            FloodKind::Looks => "looks",
            FloodKind::Loads => "loads",
            FloodKind::Nonsense => "nonsense",
        }
    }

    /// Returns the kind with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<FloodKind> {
        FloodKind::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Floods until the process is killed.
    pub(super) fn run(self, interfaces: &Interfaces) {
        thread::scope(|scope| {
            for number in 0..THREADS {
                scope.spawn(move || {
                    for turn in 0.. {
                        // Errors are ignored. Without the pause, an interface that refuses at once would let this
                        // process take the whole processor, and the run would measure only that.
                        self.once(interfaces, number, turn);
                        thread::sleep(Duration::from_millis(1));
                    }
                });
            }
        });
    }

    fn once(self, interfaces: &Interfaces, number: usize, turn: usize) {
        match self {
            FloodKind::Rejected => load(interfaces, &rejected(number + turn)),
            FloodKind::Json => json(interfaces, turn),
            FloodKind::Silent => silent(interfaces),
            FloodKind::Slow => slow(interfaces, turn),
            FloodKind::WrongTokens => wrong_token(interfaces),
            FloodKind::Looks => looks(interfaces, turn),
            FloodKind::Loads => load(interfaces, &net(&format!("load-{number}"), 5000)),
            FloodKind::Nonsense => {
                // The response does not matter.
                let _ = rest::raw(&interfaces.socket, b"\x16\x03\x01\r\n\r\n");
            }
        }
    }
}

fn rejected(number: usize) -> String {
    let line = match number % 3 {
        0 => "  x: {type: Nothing, inputs: {a: b.c}}\n",
        1 => "- \u{1}\u{2}\u{3}\n",
        _ => "  y: [1, 2, {z: \"w\"}]\n",
    };
    "net: rejected\nprimitives:\n".to_owned() + &line.repeat((4 << 20) / line.len() - 10)
}

/// Loads a net and unloads it, so that the command table does not stay full.
fn load(interfaces: &Interfaces, text: &str) {
    let loaded = interfaces.ask(Interface::Unix, "POST", "/commands", text.as_bytes());
    let Some(id) = loaded.ok().and_then(|reply| reply.body["id"].as_u64()) else {
        return;
    };
    for _ in 0..200 {
        thread::sleep(Duration::from_millis(50));
        let gone = interfaces.ask(Interface::Unix, "DELETE", &format!("/commands/{id}"), b"");
        if gone.is_ok_and(|reply| reply.status == 200 || reply.status == 404) {
            return;
        }
    }
}

fn json(interfaces: &Interfaces, turn: usize) {
    let (method, path) = [
        ("PUT", "/commands/large-0/inputs"),
        ("POST", "/commands/large-0/start"),
        ("POST", "/switch"),
        ("POST", "/commands"),
        ("POST", "/status/acknowledge"),
    ][turn % 5];
    let body = "[".to_owned() + &"{\"a\":1},".repeat((4 << 20) / 8 - 4) + "0]";
    let _ = interfaces.ask(Interface::Unix, method, path, body.as_bytes());
}

fn silent(interfaces: &Interfaces) {
    let unix: Vec<_> = (0..SILENT).map(|_| connect(&interfaces.socket)).collect();
    let tcp: Vec<_> = (0..SILENT)
        .map(|_| TcpStream::connect(interfaces.address))
        .collect();
    thread::sleep(Duration::from_millis(100));
    drop((unix, tcp));
}

fn slow(interfaces: &Interfaces, turn: usize) {
    let Some(mut stream) = connect(&interfaces.socket) else {
        return;
    };
    let text = match turn % 2 {
        0 => "GET /commands HTTP/1.1\r\nhost: x\r\nx: ".to_owned() + &"y".repeat(1000),
        _ => {
            "POST /commands HTTP/1.1\r\nhost: x\r\ncontent-length: 4000000\r\n\r\nnet: ".to_owned()
                + &"y".repeat(1000)
        }
    };
    let (quick, slow) = text.split_at(text.len() - 990);
    if stream.write_all(quick.as_bytes()).is_err() {
        return;
    }
    for byte in slow.bytes() {
        if stream.write_all(&[byte]).is_err() {
            return;
        }
        thread::sleep(Duration::from_millis(20));
    }
}

fn wrong_token(interfaces: &Interfaces) {
    let Ok(mut stream) = TcpStream::connect(interfaces.address) else {
        return;
    };
    let _ = stream.set_read_timeout(Some(Duration::from_secs(5)));
    let head = b"GET /status HTTP/1.1\r\nhost: x\r\nauthorization: Bearer wrong\r\n\r\n";
    if stream.write_all(head).is_ok() {
        let _ = stream.read(&mut [0; 512]);
    }
}

fn looks(interfaces: &Interfaces, turn: usize) {
    let interface = [Interface::Unix, Interface::Tcp][turn % 2];
    let path = [
        "/commands",
        "/commands/large-1",
        "/commands/large-1/values?ports=a1.*",
        "/status",
        "/primitives",
        "/schema",
        "/topics",
    ][turn % 7];
    let _ = interfaces.ask(interface, "GET", path, b"");
}
