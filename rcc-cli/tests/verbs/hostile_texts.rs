//! The real `rcc-cli` against a loader whose texts are all hostile: nothing printed controls the terminal, and JSON
//! output equals the answer. The loader is a thread of the test that answers over TCP.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Output;

use rcc_api::bodies::{
    ChannelView, CommandDetail, CommandView, DeviceView, ErrorBody, EventPage, EventSourceView,
    EventView, FaultView, Finding, IncidentView, LateView, ProcessView, RehearsalView, StatusView,
    TextLocation, TopicEnd, TopicView, ValueView, ValuesView,
};
use rcc_core::printable::first_unprintable;
use serde::Serialize;
use serde_json::{Value, json};

use crate::program::rcc_cli;

/// Clears the screen, sets a title, hides and reorders text.
const HOSTILE: &str = "x\u{1b}[2J\u{1b}]0;owned\u{7}\u{9b}8m\u{202e}y\u{2066}\u{200b}\r\u{7f}";
const TOKEN: &str = "0123456789abcdef0123456789abcdef";

fn text() -> String {
    HOSTILE.to_owned()
}

fn finding() -> Finding {
    let place = TextLocation {
        file: text(),
        line: 1,
        column: 1,
        length: 1,
        label: text(),
    };
    Finding {
        code: text(),
        severity: "warning".into(),
        message: text(),
        used_at: Some(place.clone()),
        place: Some(place),
        help: Some(text()),
        rendered: format!("{HOSTILE}\n"),
    }
}

fn command(state: &str) -> CommandView {
    CommandView {
        id: 1,
        net: text(),
        description: text(),
        state: state.into(),
        reason: Some(text()),
        fault: Some(FaultView {
            fault: text(),
            device: Some(text()),
            joint: Some(text()),
            words: text(),
            ..FaultView::default()
        }),
        uses: vec![text()],
        started_cycle: 1,
        rehearsal: Some(RehearsalView {
            end: text(),
            words: text(),
            ..RehearsalView::default()
        }),
        diagnostics: vec![finding()],
        ..CommandView::default()
    }
}

fn status() -> StatusView {
    let mut status = StatusView {
        cell: text(),
        config: text(),
        processes: vec![ProcessView {
            role: text(),
            label: text(),
            incarnation: text(),
            note: text(),
            ..ProcessView::default()
        }],
        ..StatusView::default()
    };
    let late = LateView {
        cause: text(),
        net: Some(text()),
        ..LateView::default()
    };
    status.executor.grade = text();
    status.executor.late = 1;
    status.executor.incarnation = text();
    status.executor.clock.state = text();
    status.executor.clock.device = Some(text());
    (status.executor.first_late, status.executor.last_late) = (Some(late.clone()), Some(late));
    status
}

fn devices() -> Vec<DeviceView> {
    vec![DeviceView {
        name: text(),
        driver: text(),
        state: text(),
        reason: text(),
        holder: Some(text()),
        joints: vec![text()],
        channels: vec![ChannelView {
            name: text(),
            kind: text(),
            unit: text(),
            on_release: Some(text()),
        }],
        ..DeviceView::default()
    }]
}

fn values() -> ValuesView {
    ValuesView {
        net: text(),
        state: "terminated".into(),
        values: vec![ValueView {
            port: text(),
            ty: "Text".into(),
            unit: Some(text()),
            value: Value::from(HOSTILE),
        }],
        ..ValuesView::default()
    }
}

fn topics() -> Vec<TopicView> {
    let end = || TopicEnd {
        net: text(),
        primitive: text(),
        state: text(),
        id: 1,
    };
    vec![TopicView {
        topic: text(),
        ty: text(),
        unit: Some(text()),
        publishers: vec![end()],
        subscribers: vec![end()],
    }]
}

fn events() -> EventPage {
    let event = EventView {
        time: "2026-11-21T16:02:03.123456Z".into(),
        source: EventSourceView {
            role: "executor".into(),
            label: text(),
            ..EventSourceView::default()
        },
        severity: "info".into(),
        kind: "stopping".into(),
        fields: json!({"why": HOSTILE}),
        words: text(),
        net: Some(text()),
        ..EventView::default()
    };
    EventPage {
        events: vec![event],
        next: "0-1".into(),
        continues: true,
    }
}

fn incidents() -> Vec<IncidentView> {
    vec![IncidentView {
        file: text(),
        name: Some(text()),
        cell: text(),
        reason: text(),
        fault: Some(text()),
        time: text(),
        ..IncidentView::default()
    }]
}

fn to_json(value: &impl Serialize) -> Value {
    serde_json::to_value(value).expect("views are JSON")
}

/// Returns the loader's answer to a request line.
fn answer(line: &str, refuses: bool) -> (u16, Value) {
    let path = line.split(' ').nth(1).unwrap_or_default();
    let path = path.split('?').next().unwrap_or_default();
    let parts: Vec<&str> = path.split('/').skip(1).collect();
    if refuses {
        let body = ErrorBody {
            code: text(),
            message: text(),
            help: Some(text()),
            diagnostics: Vec::new(),
        };
        return (409, to_json(&body));
    }
    let done = json!({"id": 1, "net": HOSTILE, "cycle": 5});
    let value = match (line.starts_with("GET"), &parts[..]) {
        (true, ["commands"]) => to_json(&vec![command("terminated")]),
        (true, ["commands", _]) => to_json(&CommandDetail {
            command: command("ready"),
            text: text(),
            names: json!({}),
        }),
        (true, ["commands", _, "values"]) => to_json(&values()),
        (true, ["devices"]) => to_json(&devices()),
        (true, ["events"]) => to_json(&events()),
        (true, ["incidents"]) => to_json(&incidents()),
        (true, ["topics"]) => to_json(&topics()),
        (true, ["status"]) => to_json(&status()),
        (true, ["timing"]) => json!({"cycle": 1, "acknowledged_cycle": 0, "period_ns": 1_000_000,
            "primitives": [{"type": HOSTILE, "runs": 1, "primitives": 1, "sum_ns": 5, "max_ns": 5}]}),
        (false, ["commands"]) => json!({"id": 1, "state": "loading"}),
        (false, ["commands", _, "inputs"]) => {
            json!({"id": 1, "net": HOSTILE, "cycle": 5, "set": [HOSTILE]})
        }
        (false, ["switch"]) => json!({"cycle": 5, "stopped": [&done], "started": [&done]}),
        _ => done,
    };
    (200, value)
}

fn serve(mut stream: TcpStream, refuses: bool) {
    let mut reader = BufReader::new(stream.try_clone().expect("a socket"));
    let (mut first, mut line, mut length) = (String::new(), String::new(), 0);
    if reader.read_line(&mut first).is_err() {
        return;
    }
    while reader.read_line(&mut line).is_ok_and(|count| count > 2) {
        if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
            length = value.trim().parse().unwrap_or(0);
        }
        line.clear();
    }
    let mut body = vec![0; length];
    if reader.read_exact(&mut body).is_err() {
        return;
    }
    let (status, value) = answer(&first, refuses);
    let body = value.to_string();
    // The client may have closed the connection already.
    let _ = write!(
        stream,
        "HTTP/1.1 {status} X\r\ncontent-type: application/json\r\nconnection: close\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
}

/// Starts a loader; returns its address.
fn start(refuses: bool) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("loopback");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            serve(stream, refuses);
        }
    });
    format!("http://{address}")
}

fn run(url: &str, format: &str, arguments: &[&str]) -> Output {
    run_with(&[&["--url", url, "--output", format][..], arguments].concat())
}

fn run_with(arguments: &[&str]) -> Output {
    let mut command = rcc_cli(&["--timeout", "20s"]);
    command.args(arguments);
    command.env("RCC_TOKEN", TOKEN).env_remove("RCC_CELL");
    command.output().expect("rcc-cli runs")
}

const VERBS: &[&[&str]] = &[
    &["ls"],
    &["state"],
    &["state", "1"],
    &["state", "1", "--values"],
    &["status"],
    &["devices"],
    &["topics"],
    &["events"],
    &["incidents"],
    &["top", "--once"],
    &["watch", "1", "--count", "1"],
    &["load", "configs/nets/blink.yaml"],
    &["start", "1"],
    &["start", "1", "--after-stopping", "2"],
    &["cancel", "1"],
    &["abort", "1"],
    &["unload", "1"],
    &["set", "1", "a=1"],
    &["explain", "1", "--config", "configs/cells/demo.yaml"],
    &["graph", "1", "--config", "configs/cells/demo.yaml"],
];

fn is_printable(output: &Output, arguments: &[&str]) -> String {
    let text = [&output.stdout[..], &output.stderr].concat();
    let text = String::from_utf8(text).expect("UTF-8");
    let found = first_unprintable(&text);
    assert_eq!(found, None, "{arguments:?} printed {text:?}");
    text
}

#[test]
fn no_verb_prints_control_characters() {
    let (answers, refuses) = (start(false), start(true));
    let mut shown = 0;
    for arguments in VERBS {
        for (url, format) in [
            (&answers, "human"),
            (&answers, "json"),
            (&refuses, "human"),
            (&refuses, "json"),
        ] {
            let text = is_printable(&run(url, format, arguments), arguments);
            shown += usize::from(text.contains("\\u001b[2J"));
        }
    }
    // Guards the test itself: most verbs must show what the loader says.
    assert!(shown > 3 * VERBS.len(), "{shown}");
}

#[test]
fn json_output_equals_the_answer() {
    let answers = start(false);
    for (arguments, expected) in [
        (&["ls"][..], to_json(&vec![command("terminated")])),
        (&["topics"], to_json(&topics())),
    ] {
        let output = run(&answers, "json", arguments);
        let said: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(said, expected, "{arguments:?}");
    }
}

#[test]
fn names_and_texts_of_files_do_not_control_the_terminal() {
    let folder = rcc_testing::folder();
    let file = folder
        .path()
        .join(format!("{}.yaml", HOSTILE.replace('/', "")));
    let net = format!(
        "net: x\ndescription: \"\\e[2J\" # {}\nprimitives: {{\"a\\e[2J\": {{type: \"b\\e]0;\"}}}}\n",
        "\u{202e}"
    );
    std::fs::write(&file, net).expect("written");
    let name = file.to_str().expect("UTF-8");
    for arguments in [
        &["check", name][..],
        &["fmt", "--check", name],
        &["graph", name],
        &["explain", name],
        &["simulate", name],
        &["convert", name],
        &["up", name],
        &["--url", "http://127.0.0.1:9", "load", name],
        &["--url", "http://127.0.0.1:9", "run", name],
        &["replay", name],
        &["incidents", name],
        &["check", HOSTILE],
        &["--url", "http://127.0.0.1:9", "state", "x", HOSTILE],
        &[HOSTILE],
    ] {
        let text = is_printable(&run_with(arguments), arguments);
        assert!(!text.is_empty(), "{arguments:?} says nothing");
    }
}
