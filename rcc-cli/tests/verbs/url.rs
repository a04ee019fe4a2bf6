//! Every verb of the real `rcc-cli` with `--url`: it asks the loader at that address, or refuses and says what to do; none
//! answers about another cell. The loader is a thread of the test that answers over TCP and notes what it was asked.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::mpsc::{Receiver, Sender, channel};

use clap::CommandFactory;
use rcc_cli::arguments::Arguments;

use crate::program::rcc_cli;

/// Answers one request with the error of a cell without an executor.
fn serve(mut stream: TcpStream, asked: &Sender<String>) {
    let mut reader = BufReader::new(stream.try_clone().expect("a second handle"));
    let mut first = String::new();
    let _ = reader.read_line(&mut first);
    let mut line = String::new();
    while reader.read_line(&mut line).is_ok_and(|length| length > 2) {
        line.clear();
    }
    // Noted before the answer: the test looks when the program has ended.
    let _ = asked.send(first);
    let body = r#"{"code": "RCC4001", "message": "the executor cannot be reached"}"#;
    let _ = write!(
        stream,
        "HTTP/1.1 503 X\r\ncontent-type: application/json\r\nconnection: close\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
}

/// Starts a loader; returns its address, and the first line of each request to it.
fn start() -> (String, Receiver<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("loopback");
    let address = listener.local_addr().expect("an address");
    let (asked, requests) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            serve(stream, &asked);
        }
    });
    (format!("http://{address}"), requests)
}

fn command(runtime: &Path, arguments: &[&str]) -> Command {
    let mut command = rcc_cli(&["--timeout", "20s"]);
    command.args(arguments);
    command
        .env("RCC_RUNTIME_DIR", runtime)
        .env_remove("RCC_CELL");
    command
}

fn run(arguments: &[&str]) -> Output {
    let folder = rcc_testing::folder();
    let output = command(folder.path(), arguments).output();
    output.expect("rcc-cli runs")
}

fn refusal(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(output.stdout.is_empty(), "{text}");
    text
}

const NET: &str = "configs/nets/blink.yaml";
const CELL: &str = "configs/cells/demo.yaml";
const TASK: &str = "configs/tasks/blink-twice.yaml";

/// Verbs that ask the loader at the address, and the beginning of their first request.
const SERVED: &[(&[&str], &str)] = &[
    (&["load", NET], "POST /commands"),
    (&["start", "1"], "POST /commands/1/start"),
    (&["run", NET], "POST /commands"),
    (&["set", "1", "a=1"], "PUT /commands/1/inputs"),
    (&["watch", "1"], "GET /commands/1/values"),
    (&["wait", "1"], "GET /commands/1"),
    (&["cancel", "1"], "POST /commands/1/cancel"),
    (&["abort", "1"], "POST /commands/1/abort"),
    (&["unload", "1"], "DELETE /commands/1"),
    (&["state"], "GET /commands"),
    (&["state", "1"], "GET /commands/1"),
    (&["ls"], "GET /commands"),
    (&["topics"], "GET /topics"),
    (&["rules", "ls"], "GET /rules"),
    (&["rules", "remove", "1"], "DELETE /rules/1"),
    (&["task", TASK], "POST /commands"),
    (&["devices"], "GET /devices"),
    (&["primitives"], "GET /primitives"),
    (&["schema"], "GET /schema"),
    (&["status"], "GET /status"),
    (&["status", "--acknowledge"], "POST /status/acknowledge"),
    (&["top", "--once"], "GET /status"),
    (&["events"], "GET /events"),
    (&["events", "--follow"], "GET /events"),
    (&["tail"], "GET /history"),
    (&["incidents"], "GET /incidents"),
    (&["incidents", "record"], "POST /incidents"),
    (&["incidents", "arm", "ft.fz > 30"], "POST /rules"),
    (&["incidents", "armed"], "GET /rules"),
    (&["incidents", "disarm", "3"], "GET /rules/3"),
    (
        &["incidents", "fetch", "x.rcc-incident"],
        "GET /incidents/x.rcc-incident",
    ),
    (&["explain", "1"], "GET /commands/1"),
    (&["explain", NET, "--config", CELL], "GET /status"),
    (&["graph", "1"], "GET /commands/1"),
];

/// Verbs that refuse the address: about the machine, or without any cell.
const REFUSED: &[&[&str]] = &[
    &["demo"],
    &["up", CELL],
    &["down"],
    &["costs"],
    &["fault", "lwr", "estop"],
    &["sim", "io"],
    &["doctor", "--measure", "0"],
    &["doctor", "device", "lwr"],
    &["serve"],
    &["fleet", "cells"],
    &["record", "/nonexistent/x.mcap"],
    &["import", "x.mcap"],
    &["import", "trajectory", "x.yaml"],
    &["install-units", CELL, "--dry-run"],
    &["rt-setup", "--root", "/nonexistent"],
    &["incidents", "--folder", "."],
    &["schema", "--config", CELL],
    &["schema", "robot"],
    &["explain", NET],
    &["graph", NET],
    &["check", NET],
    &["fmt", "--check", NET],
    &["convert", NET],
    &["robot", "import", "x.urdf"],
    &["simulate", NET],
    &["plot", NET],
    &["replay"],
    &["replay", "x"],
    &["replay", NET],
    &["wrench", "identify", "x"],
    &["completions", "bash"],
    &["man", "/nonexistent/man"],
];

#[test]
fn every_verb_serves_the_address_or_refuses_it() {
    let (url, requests) = start();
    for (arguments, first) in SERVED {
        let output = run(&[&["--url", &url][..], arguments].concat());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let asked = requests.try_recv().unwrap_or_default();
        assert!(
            asked.starts_with(first),
            "{arguments:?} asked `{asked}`: {text}"
        );
        assert_eq!(output.status.code(), Some(4), "{arguments:?}: {text}");
        while requests.try_recv().is_ok() {}
    }
    for arguments in REFUSED {
        let output = run(&[&["--url", &url][..], arguments].concat());
        let text = refusal(&output);
        let remedy =
            text.contains("help:") && (text.contains("--url") || text.contains("--config"));
        assert!(remedy, "{arguments:?}: {text}");
        assert!(requests.try_recv().is_err(), "{arguments:?}");
    }
    let tested = SERVED
        .iter()
        .map(|row| row.0)
        .chain(REFUSED.iter().copied());
    let tested: BTreeSet<&str> = tested.map(|arguments| arguments[0]).collect();
    let all = Arguments::command();
    let verbs = all.get_subcommands().map(clap::Command::get_name);
    let untested: Vec<&str> = verbs.filter(|verb| !tested.contains(verb)).collect();
    assert_eq!(untested, [""; 0], "add these verbs to the tables");
}

#[test]
fn an_address_from_the_environment_is_served_or_refused_but_never_ignored() {
    let (url, requests) = start();
    let run = |arguments: &[&str]| {
        let folder = rcc_testing::folder();
        let mut command = command(folder.path(), arguments);
        command.env("RCC_URL", &url).output().expect("rcc-cli runs")
    };
    assert_eq!(run(&["events"]).status.code(), Some(4));
    assert!(
        requests
            .try_recv()
            .is_ok_and(|asked| asked.starts_with("GET /events"))
    );
    let text = refusal(&run(&["doctor", "--measure", "0"]));
    assert!(text.contains("unset RCC_URL"), "{text}");
    // A file is checked without any cell, and a cell that the command line names is preferred.
    assert_eq!(run(&["check", NET]).status.code(), Some(0));
    let text = String::from_utf8_lossy(&run(&["--cell", "lab", "ls"]).stderr).into_owned();
    assert!(text.contains("`lab`"), "{text}");
    assert!(requests.try_recv().is_err());
    refusal(&run(&["--url", &url, "--cell", "lab", "ls"]));
}
