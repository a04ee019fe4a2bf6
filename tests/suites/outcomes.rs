//! Exit codes report the outcome of a request, and nets are addressed by number, by name, or by both. Each test has a
//! cell of its own.

use std::process::{Child, Output, Stdio};

use nix::sys::signal::Signal;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{TestCell, await_some, nets};
use serde_json::Value;

/// Starts `rcc-cli` with these arguments, without waiting for its end.
fn begin(cell: &TestCell, arguments: &[&str]) -> Child {
    let mut command = cell.program("rcc-cli");
    command
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    ends_with_test(&mut command)
        .spawn()
        .expect("rcc-cli starts")
}

/// Waits for the end of a program; returns its exit code and its output.
fn end(child: Child) -> (Option<i32>, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = child.wait_with_output().expect("the child is ours");
    let words = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
    (status.code(), words)
}

/// Waits until the newest net of this name runs; returns its id.
fn await_running(cell: &TestCell, name: &str) -> u64 {
    await_some(&format!("{name} to run"), || {
        let rows = cell.rest("GET", "/commands", "").body;
        let row = rows
            .as_array()?
            .iter()
            .rfind(|row| row["net"] == name && row["state"] == "running")?;
        row["id"].as_u64()
    })
}

#[test]
fn run_succeeds_only_if_its_net_finishes() {
    let cell = TestCell::demo();
    let clock = cell.file(&nets::clock("clock"));
    let clock = clock.to_str().expect("plain");
    // The net is ended by CANCEL or ABORT of another client, or by a signal to `run` itself.
    for (what, exit, word) in [
        ("cancel", 8, "canceled"),
        ("abort", 1, "aborted"),
        ("interrupt", 130, "canceled"),
    ] {
        for format in ["human", "json"] {
            let run = begin(&cell, &["--output", format, "run", clock]);
            let watch_id = await_running(&cell, "clock");
            let watch = begin(&cell, &["watch", &watch_id.to_string()]);
            let wait = begin(&cell, &["wait", &watch_id.to_string()]);
            match what {
                "interrupt" => assert!(signal(run.id(), Signal::SIGINT)),
                what => cell.done(watch_id, what),
            }
            let (code, words) = end(run);
            assert_eq!(code, Some(exit), "{what}, {format}: {words}");
            assert!(words.contains(word), "{what}, {format}: {words}");
            // Others are told how it ended, although `run` has unloaded it.
            for follower in [watch, wait] {
                let (code, words) = end(follower);
                let of_net = if what == "abort" { 1 } else { 8 };
                assert_eq!(code, Some(of_net), "{what}: {words}");
                assert!(words.contains(word), "{what}: {words}");
            }
        }
    }
    let short =
        cell.file("net: short\nprimitives:\n  end: {type: Termination, inputs: {done: true}}\n");
    let (out, _) = cell.cli_exits(0, &["run", short.to_str().expect("plain")]);
    assert!(out.contains("finished"), "{out}");
    cell.stop();
}

#[test]
fn the_exit_code_of_every_verb_reports_the_outcome() {
    let cell = TestCell::demo();
    let watched = |reason: &str, exit: i32, what: &str| {
        let id = cell.run(&nets::clock("clock"));
        let watch = begin(&cell, &["watch", "clock"]);
        let wait = begin(&cell, &["wait", "clock"]);
        match what {
            "wait" => drop(cell.cli_exits(exit, &["cancel", "clock", "--wait"])),
            what => cell.done(id, what),
        }
        cell.assert_ends(id, reason);
        for verb in [watch, wait] {
            let (code, words) = end(verb);
            assert_eq!(code, Some(exit), "{reason}: {words}");
            assert!(words.contains(reason), "{words}");
        }
        // A net that has ended is not waited for.
        cell.cli_exits(exit, &["wait", &id.to_string()]);
    };
    watched("canceled", 8, "wait");
    watched("canceled", 8, "cancel");
    watched("aborted", 1, "abort");
    // The net does not obey CANCEL, and ends by ABORT instead.
    let deaf = "net: deaf
primitives:
  cancel: {type: Cancel}
  heard: {type: Monitor, parameters: {rate: 10 Hz}, inputs: {value: cancel.requested}}
  end: {type: Termination, inputs: {done: false}}
";
    let id = cell.run(deaf);
    let (_, words) = cell.cli_exits(6, &["cancel", "deaf", "--wait", "100ms"]);
    assert!(words.contains("rcc-cli abort"), "{words}");
    cell.done(id, "abort");
    let id = cell.run(deaf);
    let wait = begin(&cell, &["cancel", "deaf", "--wait"]);
    await_some("the cancel", || {
        (cell.state(id)["state"] == "canceling").then_some(())
    });
    cell.done(id, "abort");
    let (code, words) = end(wait);
    assert_eq!(code, Some(1), "{words}");
    let empty = cell.folder().join("empty");
    std::fs::create_dir(&empty).expect("a folder");
    let bad = cell.file("net: bad\nprimitives: {}\n");
    let bad = bad.to_str().expect("plain");
    for (exit, arguments) in [
        (3, vec!["load", bad]),
        (3, vec!["run", bad]),
        (3, vec!["check", bad]),
        (3, vec!["simulate", bad]),
        (1, vec!["start", "nothing"]),
        (1, vec!["abort", "nothing"]),
        (1, vec!["set", "nothing", "x=1"]),
        (5, vec!["start", "deaf"]),
        (5, vec!["cancel", "deaf", "--wait"]),
        (5, vec!["abort", "deaf"]),
        (0, vec!["unload", "deaf"]),
        (0, vec!["unload", "deaf"]),
        (1, vec!["unload", "deaf"]),
        (1, vec!["wait", "nothing"]),
        (2, vec!["wait"]),
        (2, vec!["unload"]),
        (2, vec!["unload", "--all", "deaf"]),
        (2, vec!["fault", "nothing", "kill"]),
        (2, vec!["check", empty.to_str().expect("plain")]),
    ] {
        let _: (String, String) = cell.cli_exits(exit, &arguments);
    }
    cell.stop();
}

#[test]
fn a_net_is_addressed_by_number_by_name_or_by_both_which_must_agree() {
    let cell = TestCell::demo();
    let number =
        cell.file("net: \"1\"\nprimitives:\n  end: {type: Termination, inputs: {done: true}}\n");
    for verb in ["check", "load", "run"] {
        let (_, words) = cell.cli_exits(3, &[verb, number.to_str().expect("plain")]);
        assert!(
            words.contains("RCC1104") && words.contains("net-1"),
            "{words}"
        );
    }
    let left = cell.load(&nets::clock("left"));
    let right = cell.load(&nets::clock("right"));
    let wrong = format!("left#{right}");
    for verb in [
        "start", "cancel", "abort", "unload", "state", "watch", "set", "explain",
    ] {
        let (_, words) = cell.cli_exits(1, &[verb, &wrong]);
        assert!(
            words.contains("RCC3001") && words.contains("`right`"),
            "{verb}: {words}"
        );
    }
    let (_, words) = cell.cli_exits(
        1,
        &[
            "start",
            &format!("right#{right}"),
            "--after-stopping",
            &wrong,
        ],
    );
    assert!(words.contains("`right`"), "{words}");
    for path in [
        format!("left%23{right}"),
        format!("left%230{left}"),
        format!("0{left}"),
        "left%23x".to_owned(),
        "1%2F".to_owned(),
    ] {
        let reply = cell.rest("POST", &format!("/commands/{path}/start"), "");
        assert_eq!(
            (reply.status, reply.code()),
            (404, "RCC3001"),
            "{path}: {reply:?}"
        );
    }
    for id in [left, right] {
        assert_eq!(cell.state(id)["state"], "ready", "the net has not changed");
    }
    // The number, the name, and both together address the same net.
    cell.cli_exits(0, &["start", &format!("left#{left}")]);
    cell.cli_exits(0, &["start", &right.to_string()]);
    for (id, name) in [(left, "left"), (right, "right")] {
        assert_eq!(cell.state(id)["state"], "running");
        let by_name: Value = cell.rest("GET", &format!("/commands/{name}"), "").body;
        assert_eq!(by_name["id"], id);
        cell.cli_exits(8, &["cancel", name, "--wait"]);
    }
    cell.stop();
}

/// A net that begins where it ends, or ends when its input `touched` is set; `start` is the condition `arrived`.
fn named(net: &str, arrived: &str) -> String {
    format!(
        "net: {net}
primitives:
  touched: {{type: Input, parameters: {{initial: false}}}}
  cancel: {{type: Cancel}}
  end: {{type: Termination, inputs: {{done: {{arrived: {arrived}, touched: touched.value, stopped: cancel.requested}}}}}}
"
    )
}

#[test]
fn a_named_outcome_is_shown_wherever_a_net_ends() {
    let cell = TestCell::demo();
    // It ends with an outcome other than the first one.
    let id = cell.run(&named("part", "false"));
    let wait = begin(&cell, &["wait", "part"]);
    let json = begin(&cell, &["--output", "json", "wait", "part"]);
    cell.cli_exits(0, &["set", "part", "touched=true"]);
    cell.assert_ends(id, "finished");
    let (code, words) = end(wait);
    assert_eq!(code, Some(0), "{words}");
    assert!(words.contains("terminated (finished: touched)"), "{words}");
    let (code, words) = end(json);
    assert_eq!(code, Some(0), "{words}");
    let row: Value = serde_json::from_str(&words).expect("one object");
    assert_eq!(
        (row["reason"].as_str(), row["outcome"].as_str()),
        (Some("finished"), Some("touched"))
    );
    let body = cell.state(id);
    assert_eq!(
        (body["outcome"].as_str(), body["words"].as_str()),
        (Some("touched"), Some("finished: touched"))
    );
    for arguments in [vec!["ls"], vec!["state", "part"]] {
        let (words, _) = cell.cli_exits(0, &arguments);
        assert!(
            words.contains("finished: touched"),
            "{arguments:?}: {words}"
        );
    }
    await_some("the event", || {
        let (words, _) = cell.cli_exits(0, &["events", "--net", "part"]);
        words
            .contains("terminated: finished: touched")
            .then_some(())
    });
    // It ends in its first cycle, and says so.
    let at_once = cell.file(&named("at-once", "true"));
    let at_once = at_once.to_str().expect("plain");
    let (out, note) = cell.cli_exits(0, &["run", at_once]);
    assert!(
        out.contains("terminated (finished in its first cycle: arrived)"),
        "{out}"
    );
    assert!(
        note.contains("the outcome `arrived` was true from the start"),
        "{note}"
    );
    let (out, _) = cell.cli_exits(0, &["simulate", at_once]);
    assert!(
        out.contains("finished in its first cycle: arrived"),
        "{out}"
    );
    // A canceled net names the condition that ended it as well.
    let id = cell.run(&named("stopped", "false"));
    cell.cli_exits(8, &["cancel", "stopped", "--wait"]);
    let body = cell.state(id);
    assert_eq!(
        (body["reason"].as_str(), body["outcome"].as_str()),
        (Some("canceled"), Some("stopped"))
    );
    cell.stop();
}

#[test]
fn a_name_that_no_net_has_is_answered_with_the_one_that_is_most_like_it() {
    let cell = TestCell::demo();
    let id = cell.load(&nets::clock("welding-line"));
    for verb in [
        "start", "cancel", "state", "watch", "wait", "unload", "explain", "set",
    ] {
        let (_, words) = cell.cli_exits(1, &[verb, "weldingline"]);
        assert!(
            words.contains("did you mean `welding-line`?"),
            "{verb}: {words}"
        );
    }
    let answer = cell.rest("GET", "/commands/weldingline", "");
    assert_eq!((answer.status, answer.code()), (404, "RCC3001"));
    assert_eq!(cell.state(id)["state"], "ready");
    cell.stop();
}

#[test]
fn unload_all_leaves_what_runs() {
    let cell = TestCell::demo();
    cell.cli_exits(0, &["unload", "--all"]);
    let running = cell.run(&nets::clock("running"));
    cell.load(&nets::clock("ready"));
    let done = cell.run(&nets::clock("done"));
    cell.done(done, "abort");
    cell.assert_ends(done, "aborted");
    let (out, note) = cell.cli_exits(0, &["unload", "--all"]);
    assert!(out.contains("ready#") && out.contains("done#"), "{out}");
    assert!(note.contains("running#"), "{note}");
    let rows = cell.rest("GET", "/commands", "").body;
    let left: Vec<&Value> = rows
        .as_array()
        .expect("a list")
        .iter()
        .map(|row| &row["id"])
        .collect();
    assert_eq!(left, [&Value::from(running)]);
    cell.stop();
}

#[test]
fn wait_ends_with_the_time_and_with_ctrl_c_and_changes_nothing() {
    let cell = TestCell::demo();
    let id = cell.run(&nets::clock("clock"));
    let (_, words) = cell.cli_exits(6, &["wait", "clock", "--for", "50ms"]);
    assert!(words.contains("still running"), "{words}");
    let mut wait = begin(&cell, &["wait", "clock", "clock"]);
    // Repeated: a process whose parent ignores the signal ignores it too until it listens.
    await_some("the end of the wait", || {
        signal(wait.id(), Signal::SIGINT);
        wait.try_wait().expect("a child of this process")
    });
    let (code, words) = end(wait);
    assert!(matches!(code, Some(130) | None), "{code:?} {words}");
    assert_eq!(cell.state(id)["state"], "running");
    cell.stop();
}
