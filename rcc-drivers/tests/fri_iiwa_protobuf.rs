//! The FRI messages of the iiwa against Google's Protocol Buffers, whose schema is written apart, in Python.
//! Runs in the test harness; needs `python3` with `protobuf`, and says if it is missing.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command as Process, Stdio};

use rcc_drivers::fri_iiwa::wire::schema::{Command, Monitoring};
use rcc_drivers::fri_iiwa::wire::{DATAGRAM_MAX, FriMessage, Version, WireError, decode, encode};

/// Random messages of each kind.
const MESSAGES: usize = 500;
const VERSIONS: [Version; 4] = [Version::V1_11, Version::V1_14, Version::V2_5, Version::V2_7];

struct Google {
    process: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Google {
    /// Returns `None` if no Python here has `protobuf`.
    fn start() -> Option<Self> {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
        let pythons = [
            format!("{root}/target/python/venv/bin/python"),
            "python3".to_owned(),
        ];
        pythons.iter().find_map(|python| Self::start_with(python))
    }

    fn start_with(python: &str) -> Option<Self> {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fri_iiwa_protobuf.py");
        let mut process = Process::new(python)
            .arg(script)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let (orders, answers) = (process.stdin.take()?, process.stdout.take()?);
        let mut google = Self {
            process,
            orders,
            answers: BufReader::new(answers),
        };
        (google.line() == "ready").then_some(google)
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.answers.read_line(&mut line).expect("a pipe");
        line.trim_end().to_owned()
    }

    fn ask(&mut self, order: &str, kind: &str, text: &str) -> String {
        writeln!(self.orders, "{order} {kind} {text}").expect("a pipe");
        self.line()
    }
}

impl Drop for Google {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn from_hex(text: &str) -> Vec<u8> {
    let digits = |at: usize| u8::from_str_radix(&text[at..at + 2], 16).expect(text);
    (0..text.len()).step_by(2).map(digits).collect()
}

fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Google makes a message, we read it in all versions and write it again, Google reads that: all bytes are the same.
fn both_ways<M: FriMessage + Clone + PartialEq>(google: &mut Google, kind: &str) {
    let mut fit = 0;
    for seed in 0..MESSAGES {
        let made = google.ask("make", kind, &format!("{kind}-{seed}"));
        let message = M::decode(from_hex(&made).as_slice()).expect("Google's bytes");
        assert_eq!(to_hex(&message.encode_to_vec()), made, "{kind} {seed}");
        assert_eq!(
            google.ask("read", kind, &to_hex(&message.encode_to_vec())),
            made
        );
        for version in VERSIONS {
            let datagram = match encode(version, &message) {
                Err(WireError::Size(size)) if size > DATAGRAM_MAX => continue,
                datagram => datagram.expect("it fits"),
            };
            let read: M =
                decode(version, &datagram).unwrap_or_else(|error| panic!("{kind} {seed}: {error}"));
            assert!(read == message, "{kind} {seed} {version:?}");
            let theirs = match version.is_framed() {
                true => google.ask("frame", kind, &made),
                false => made.clone(),
            };
            assert_eq!(to_hex(&datagram), theirs, "{kind} {seed} {version:?}");
            fit += 1;
        }
    }
    assert!(fit > MESSAGES, "{fit} fit into a datagram");
}

#[test]
fn google_reads_what_we_write_and_we_read_what_google_writes() {
    let Some(mut google) = Google::start() else {
        eprintln!("skipped: no python3 with protobuf (.ci/python installs it)");
        return;
    };
    both_ways::<Monitoring>(&mut google, "Monitoring");
    both_ways::<Command>(&mut google, "Command");
    // A header alone, as the robot gets it in every monitoring state.
    let header = "0a080881800d10641864".to_owned();
    let framed = format!("0a000000{header}4679d783");
    assert_eq!(google.ask("read", "Command", &header), header);
    assert_eq!(google.ask("frame", "Command", &header), framed);
}
