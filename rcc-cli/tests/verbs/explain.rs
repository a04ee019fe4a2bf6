//! `check`, `explain` and `graph` as a user types them: the commands of docs/explain.md, exit codes, folders and pipes.
//! Needs no cell. Run by a thread of the test harness.

use std::io::Write;
use std::process::Stdio;

use rcc_testing::TempDir;
use serde_json::Value;

use crate::program::{rcc_cli, repository, run, texts};

/// A temporary folder, removed at the end.
struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(rcc_testing::folder())
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    }

    fn path(&self) -> &str {
        self.0.path().to_str().expect("UTF-8")
    }
}

const GOOD: &str = "net: good
primitives:
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
";
const BAD: &str = "net: bad
primitives:
  end: {type: Termination, inputs: {done: cancl.requested}}
  odd: {type: Nothing}
";

#[test]
fn the_commands_of_the_docs_run() {
    let folder = Folder::new();
    let docs = std::fs::read_to_string(repository().join("docs/explain.md")).expect("the docs");
    let commands = docs
        .lines()
        .filter_map(|line| line.strip_prefix("$ rcc-cli "));
    let mut count = 0;
    for command in commands {
        let file = folder.0.path().join("guarded-line.svg");
        let file = file.to_str().expect("UTF-8");
        let words: Vec<&str> = command
            .split_whitespace()
            .map(|word| {
                if word == "guarded-line.svg" {
                    file
                } else {
                    word
                }
            })
            .collect();
        let (code, out, err) = run(&words);
        assert_eq!(code, Some(0), "{command}: {out}{err}");
        count += 1;
    }
    assert!(count >= 6, "{count}");
    assert!(folder.0.path().join("guarded-line.svg").is_file());
}

/// The sections of the motions of a shipped net, as `explain` plans them: motion, time scaling, duration (s).
fn planned(net: &str) -> Vec<(String, String, f64)> {
    let file = format!("configs/nets/{net}.yaml");
    let (code, out, err) = run(&["--output", "json", "explain", &file]);
    assert_eq!(code, Some(0), "{out}{err}");
    let explained: Value = serde_json::from_str(&out).expect("JSON");
    let motions = &explained["motions"];
    assert!(
        motions["planning_ns"].as_u64().expect("a time") > 0,
        "{out}"
    );
    let sections = motions["sections"].as_array().expect("a list").iter();
    let text = |value: &Value| value.as_str().expect("a text").to_owned();
    let row = |it: &Value| {
        let duration_s = it["duration_s"].as_f64().expect("a number");
        (text(&it["motion"]), text(&it["time_scaling"]), duration_s)
    };
    sections.map(row).collect()
}

#[test]
fn explain_tells_how_each_motion_is_planned() {
    let even = planned("guarded-line");
    assert_eq!(even.len(), 1, "{even:?}");
    assert_eq!((&*even[0].0, &*even[0].1), ("move", "even"));
    let soonest = planned("time-optimal");
    assert!(!soonest.is_empty());
    for (motion, time_scaling, duration_s) in &soonest {
        assert_eq!(time_scaling, "time-optimal", "{motion}");
        assert!((0.1..10.0).contains(duration_s), "{motion}: {duration_s} s");
    }
    // The duration of the net itself, in whole cycles.
    let file = "configs/nets/time-optimal.yaml";
    let (code, out, err) = run(&["--output", "json", "simulate", file]);
    assert_eq!(code, Some(0), "{out}{err}");
    let ran: Value = serde_json::from_str(&out).expect("JSON");
    let cycles = ran["cycles"].as_u64().expect("a number") as f64;
    let planned: f64 = soonest.iter().map(|row| row.2).sum();
    assert!((cycles * 1e-3 - planned).abs() < 0.05, "{cycles} {planned}");
}

#[test]
fn a_folder_gets_one_summary_line_and_its_errors() {
    let folder = Folder::new();
    folder.write("a.yaml", GOOD);
    folder.write("deep/er/b.yaml", GOOD);
    folder.write("other.json", "{\"name\": \"net\"}\n");
    folder.write("notes.txt", "net: no\n");
    let (code, out, err) = run(&["check", folder.path()]);
    assert_eq!(code, Some(0), "{out}{err}");
    assert!(out.starts_with("2 nets: all valid; "), "{out}");
    let lines: Vec<&str> = err.lines().collect();
    assert_eq!(lines.len(), 2, "{err}");
    assert!(
        lines[0].contains("other.json") && lines[0].contains("no key `net`"),
        "{err}"
    );
    assert!(
        lines[1].contains("1 file") && lines[1].contains(".txt"),
        "{err}"
    );
    folder.write("c.yaml", BAD);
    let (code, out, err) = run(&["check", folder.path()]);
    assert_eq!(code, Some(3), "{out}{err}");
    assert!(
        out.starts_with("3 nets: 2 valid, 1 not, 2 errors; "),
        "{out}"
    );
    assert!(err.contains("RCC1202") && err.contains("RCC1201"), "{err}");
}

#[test]
fn nets_of_every_notation_are_found_in_a_folder() {
    let folder = Folder::new();
    folder.write("mark.yaml", &format!("\u{feff}{GOOD}"));
    folder.write("blank.yaml", &GOOD.replace("net: ", "net : "));
    folder.write("tab.yaml", &GOOD.replace("net: ", "net:\t"));
    folder.write(
        "compact.json",
        r#"{"primitives":{"cancel":{"type":"Cancel"},"end":{"type":"Termination","inputs":{"done":"cancel.requested"}}},"net":"good"}"#,
    );
    let (code, out, err) = run(&["check", folder.path()]);
    assert_eq!((code, err.as_str()), (Some(0), ""), "{out}");
    assert!(out.starts_with("4 nets: all valid; "), "{out}");
    let (_, unnamed) = GOOD.split_once('\n').expect("two lines");
    folder.write("unnamed.yaml", unnamed);
    folder.write("indented.yaml", &GOOD.replace("  end", "\tend"));
    let (code, out, err) = run(&["check", folder.path()]);
    assert_eq!(code, Some(3), "{out}{err}");
    assert!(out.starts_with("6 nets: 4 valid, 2 not"), "{out}");
    assert!(err.contains("the net has no name"), "{err}");
    assert!(err.contains("not with tabs"), "{err}");
}

#[test]
fn cells_robots_and_libraries_have_checks_of_their_own() {
    let kind = |arguments: &[&str]| {
        let (code, out, err) = run(&[&["check"], arguments].concat());
        assert_eq!((code, err.as_str()), (Some(0), ""), "{out}");
        out
    };
    let out = kind(&["configs/cells/demo.yaml"]);
    assert!(
        out.contains("cell demo is valid, 2 devices: lwr, io"),
        "{out}"
    );
    let out = kind(&["configs/robots/lwr4plus.yaml"]);
    assert!(
        out.contains("robot KUKA LWR 4+ is valid, 7 joints"),
        "{out}"
    );
    let out = kind(&["configs/cells", "configs/robots"]);
    let files = |folder: &str| {
        let files = std::fs::read_dir(repository().join(folder));
        files.expect("a folder").count()
    };
    let (cells, robots) = (files("configs/cells"), files("configs/robots"));
    let counts = format!("{cells} cells and {robots} robots: all valid");
    assert!(out.starts_with(&counts), "{out}");

    let folder = Folder::new();
    folder.write("cell.yaml", "cell: a\nperiod: 1\ndevices: {}\n");
    folder.write(
        "robot.yaml",
        "robot: a\nkinematics: {type: srs}\njoints: {}\n",
    );
    folder.write("library.yaml", "library: a\nfragmens: {}\n");
    let (code, out, err) = run(&["check", folder.path(), "--json"]);
    assert_eq!(code, Some(3), "{out}{err}");
    let found: Vec<Value> = out
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    for (verdict, (kind, code)) in found.iter().zip([
        ("cell", "RCC2006"),
        ("library", "RCC1101"),
        ("robot", "RCC2003"),
    ]) {
        assert_eq!(verdict["kind"], kind, "{verdict}");
        assert_eq!(verdict["diagnostics"][0]["code"], code, "{verdict}");
    }
    assert_eq!(found.len(), 3, "{out}");
}

#[test]
fn a_verb_for_nets_refuses_the_file_of_a_cell_with_one_error() {
    for verb in ["simulate", "graph"] {
        let (code, out, err) = run(&[verb, "configs/cells/demo.yaml"]);
        assert_eq!(code, Some(3), "{out}{err}");
        assert_eq!(err.matches("RCC").count(), 1, "{err}");
        assert!(
            err.contains("expected a net, found the configuration of a cell"),
            "{err}"
        );
    }
}

#[test]
fn a_graph_is_drawn_in_the_format_that_its_file_name_says() {
    let folder = Folder::new();
    let net = "configs/nets/blink.yaml";
    for (name, begins) in [
        ("a.svg", "<svg"),
        ("a.dot", "digraph"),
        ("a.gv", "digraph"),
        ("a.mmd", "flowchart"),
    ] {
        let path = folder.0.path().join(name);
        let (code, _, err) = run(&["graph", net, "-o", path.to_str().expect("UTF-8")]);
        assert_eq!(code, Some(0), "{err}");
        let text = std::fs::read_to_string(&path).expect("written");
        assert!(text.starts_with(begins), "{name}: {text:.40}");
    }
    let path = folder.0.path().join("a.png");
    let arguments = ["graph", net, "-o", path.to_str().expect("UTF-8")];
    let (code, _, err) = run(&arguments);
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("`.png`") && err.contains(".svg"), "{err}");
    assert!(!path.exists());
    let (code, _, err) = run(&[&arguments[..], &["--format", "svg"]].concat());
    assert_eq!(code, Some(0), "{err}");
}

#[test]
fn one_json_object_a_file_has_all_its_findings() {
    let folder = Folder::new();
    folder.write("a.yaml", BAD);
    folder.write("b.yaml", GOOD);
    let (code, out, err) = run(&["check", "--json", folder.path()]);
    assert_eq!((code, err.as_str()), (Some(3), ""));
    let lines: Vec<Value> = out
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["valid"], false);
    assert_eq!(lines[0]["diagnostics"].as_array().map(Vec::len), Some(2));
    assert_eq!(
        (&lines[1]["valid"], &lines[1]["net"]),
        (&true.into(), &"good".into())
    );
}

#[test]
fn an_unreadable_file_does_not_hide_the_others() {
    let folder = Folder::new();
    folder.write("bad.yaml", BAD);
    let missing = folder.0.path().join("missing.yaml");
    let bad = folder.0.path().join("bad.yaml");
    let [missing, bad] = [&missing, &bad].map(|path| path.to_str().expect("UTF-8"));
    let (code, out, err) = run(&["check", missing, bad]);
    assert_eq!(code, Some(2), "{out}");
    assert!(
        err.contains("missing.yaml") && err.contains("RCC1202"),
        "{err}"
    );
    assert!(out.starts_with("1 net: 0 valid, 1 not"), "{out}");
}

#[test]
fn the_standard_input_is_checked_and_warnings_can_be_denied() {
    let text = "net: moves
primitives:
  move: {type: JointState, parameters: {device: lwr}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: move.hold}}
  time: {type: Time}
  over: {type: Greater, inputs: {a: time.out, b: 1 s}}
  end: {type: Termination, inputs: {done: over.out}}
discard: [move.position]
";
    for (arguments, code) in [
        (&["check", "-"][..], 0),
        (&["check", "-", "--deny", "warnings"], 3),
    ] {
        let mut child = rcc_cli(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it runs");
        let mut stdin = child.stdin.take().expect("a pipe");
        stdin.write_all(text.as_bytes()).expect("written");
        drop(stdin);
        let (ended, out, err) = texts(child.wait_with_output().expect("it ends"));
        assert_eq!(ended, Some(code), "{out}{err}");
        assert!(err.contains("RCC1901"), "{err}");
    }
}

#[test]
fn an_explanation_lists_primitives_in_evaluation_order() {
    let (code, out, err) = run(&[
        "explain",
        "configs/nets/guarded-line.yaml",
        "--output",
        "json",
    ]);
    assert_eq!(code, Some(0), "{err}");
    let net: Value = serde_json::from_str(&out).expect("JSON");
    let order = net["order"].as_array().expect("steps");
    let place = |id: &str| {
        let found = order.iter().position(|step| step["id"] == id);
        found.unwrap_or_else(|| panic!("{id}"))
    };
    for pair in ["ft", "force", "touch", "stop", "move", "ik", "robot"].windows(2) {
        assert!(place(pair[0]) < place(pair[1]), "{pair:?}");
    }
    assert_eq!(order[place("force")]["null"], "`lwr` is lost: ft");
    assert_eq!(order[place("move")]["null"], Value::Null);
    let memory = &net["memory"];
    let bytes = |key: &str| memory[key].as_u64().expect("bytes");
    assert_eq!(
        bytes("arena_bytes"),
        bytes("output_bytes") + bytes("delayed_bytes") + bytes("other_bytes")
    );
    let then = net["consequences"].as_array().expect("consequences");
    let of = |input: &str| then.iter().find(|it| it["input"] == input);
    assert!(
        of("robot.position").is_some() && of("move.stop").is_some(),
        "{then:?}"
    );
    assert!(of("end.done").is_none(), "{then:?}");
}

#[test]
fn a_missing_net_is_refused_with_a_reason() {
    for verb in ["explain", "graph"] {
        let (code, _, err) = run(&[verb, "nowhere"]);
        assert_eq!(code, Some(4), "{err}");
        assert!(err.contains("file `nowhere` not found"), "{err}");
    }
}

/// Counts the entries of `primitives:` in a net that `fmt` has written.
fn primitives_of(text: &str) -> u64 {
    let mut lines = text
        .lines()
        .skip_while(|line| *line != "primitives:")
        .skip(1);
    let block = lines
        .by_ref()
        .take_while(|line| line.is_empty() || line.starts_with([' ', '#']));
    let entry = |line: &&str| {
        line.strip_prefix("  ")
            .is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_lowercase()))
    };
    block.filter(entry).count() as u64
}

#[test]
fn check_and_explain_count_the_primitives_of_the_text() {
    let mut count = 0;
    for entry in std::fs::read_dir(repository().join("configs/nets")).expect("the nets") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "yaml") {
            continue;
        }
        let file = path.to_str().expect("UTF-8");
        let expected = primitives_of(&std::fs::read_to_string(file).expect("a net"));
        for verb in ["check", "explain"] {
            let (code, out, err) = run(&[verb, file, "--output", "json"]);
            assert_eq!(code, Some(0), "{verb} {file}: {err}");
            let told: Value = serde_json::from_str(&out).expect("JSON");
            let told = told.pointer("/files/0").unwrap_or(&told);
            assert_eq!(told["primitives"], expected, "{verb} {file}");
        }
        count += 1;
    }
    assert!(count >= 20, "{count}");
}
