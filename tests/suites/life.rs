//! The life cycle of commands through all processes, with every refusal, by REST and by the command line.
//! Each test has a cell of its own.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use nix::sys::signal::Signal;
use rcc_tests::processes::signal;
use rcc_tests::{TestCell, await_some, nets};
use serde_json::Value;

#[test]
fn a_busy_resource_names_its_holder_by_name() {
    let cell = TestCell::demo();
    let first = cell.run(&nets::line("first", 0.2, 0.1));
    let second = cell.load(&nets::line("second", -0.2, 0.1));
    let refused = cell.operate(second, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3004"),
        "{refused:?}"
    );
    let words = refused.error_text();
    assert!(
        words.contains(&format!("first#{first}")) && words.contains("lwr"),
        "{words}"
    );
    assert_eq!(cell.state(second)["state"], "ready", "nothing changed");
    let (_, errors) = cell.cli_exits(5, &["start", "second"]);
    assert!(
        errors.contains("RCC3004") && errors.contains("first"),
        "{errors}"
    );
    cell.done(first, "cancel");
    cell.assert_ends(first, "canceled");
    cell.stop();
}

#[test]
fn the_answer_to_load_waits_until_the_net_is_ready_or_rejected_if_asked_to() {
    let cell = TestCell::demo();
    let load = |query: &str, text: &str| cell.rest("POST", &format!("/commands{query}"), text);
    let line = nets::line("line", 0.2, 0.1);
    for (query, text, state) in [
        ("", line.as_str(), "loading"),
        ("?wait_ms=0", &line, "loading"),
        ("?wait_ms=5000", &line, "ready"),
        ("?wait_ms=5000&file=bad.yaml", "net: bad", "rejected"),
    ] {
        let reply = load(query, text);
        assert_eq!(
            (reply.status, &reply.body["state"]),
            (202, &state.into()),
            "{query}: {reply:?}"
        );
        if state != "loading" {
            let id = reply.body["id"].as_u64().expect("an id");
            // The table of the very cycle may be read before it is written.
            await_some(&format!("{state} in the table"), || {
                (cell.state(id)["state"] == state).then_some(())
            });
        }
    }
    let refused = load("?wait_ms=5001", &line);
    assert_eq!(
        (refused.status, refused.code()),
        (400, "RCC4011"),
        "{refused:?}"
    );
    assert!(
        refused.error_text().contains("maximum is 5000"),
        "{refused:?}"
    );
    let commands = cell.rest("GET", "/commands", "").body;
    assert_eq!(
        commands.as_array().map(Vec::len),
        Some(4),
        "nothing was loaded: {commands}"
    );
    cell.stop();
}

#[test]
fn a_request_that_the_state_does_not_allow_is_refused_and_changes_nothing() {
    let cell = TestCell::demo();
    let id = cell.load(&nets::uncancelable_line("stubborn", 0.2, 0.1));
    let code = |what: &str| {
        let reply = cell.operate(id, what);
        assert_eq!(reply.status, 409, "{reply:?}");
        reply.code().to_owned()
    };
    assert_eq!(code("cancel"), "RCC3003", "it does not run");
    assert_eq!(code("abort"), "RCC3003", "it does not run");
    cell.start_when_ready(id);
    assert_eq!(code("start"), "RCC3003", "it runs");
    assert_eq!(code("cancel"), "RCC3007", "it has no Cancel");
    let unload = cell.rest("DELETE", &format!("/commands/{id}"), "");
    assert_eq!(
        (unload.status, unload.code()),
        (409, "RCC3003"),
        "it runs: {unload:?}"
    );
    assert_eq!(cell.state(id)["state"], "running");
    cell.done(id, "abort");
    cell.assert_ends(id, "aborted");
    assert_eq!(code("start"), "RCC3003", "a command runs once");
    let unload = cell.rest("DELETE", &format!("/commands/{id}"), "");
    assert_eq!(unload.status, 200, "{unload:?}");
    let gone = cell.rest("GET", &format!("/commands/{id}"), "");
    assert_eq!((gone.status, gone.code()), (404, "RCC3001"), "{gone:?}");
    cell.stop();
}

#[test]
fn a_command_that_was_not_loaded_is_unknown_to_every_verb() {
    let cell = TestCell::demo();
    for what in ["start", "cancel", "abort"] {
        let reply = cell.operate(4711, what);
        assert_eq!(
            (reply.status, reply.code()),
            (404, "RCC3001"),
            "{what}: {reply:?}"
        );
        let (_, errors) = cell.cli_exits(1, &[what, "nothing"]);
        assert!(
            errors.contains("RCC3001") && errors.contains("nothing"),
            "{errors}"
        );
    }
    cell.cli_exits(1, &["unload", "nothing"]);
    cell.cli_exits(1, &["state", "nothing"]);
    cell.stop();
}

/// Returns a line to `y` that can only be started at `from` (coordinates along y, m).
fn line_from(name: &str, from: f64, y: f64) -> String {
    let from = format!("from: {{xyz: [0.538, {from}, 0.384], quat: [0, 1, 0, 0]}}");
    nets::line(name, y, 0.2).replace("      to:", &format!("      {from}\n      to:"))
}

#[test]
fn a_net_that_starts_elsewhere_is_refused_with_joint_and_values_and_stays_ready() {
    let cell = TestCell::demo();
    let first = cell.load(&line_from("first", 0.1, 0.05));
    let refused = cell.operate(first, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3011"),
        "{refused:?}"
    );
    let words = refused.error_text();
    assert!(
        words.contains("lwr") && words.contains("J1") && words.contains("rad"),
        "{words}"
    );
    assert_eq!(cell.state(first)["state"], "ready");
    assert_eq!(cell.state(first)["cycles"], 0, "no cycle is counted");
    // Once the arm is at the start of the line, the same command starts.
    let there = cell.run(&nets::line("there", 0.1, 0.2));
    cell.assert_ends(there, "finished");
    cell.start_when_ready(first);
    cell.assert_ends(first, "finished");
    cell.stop();
}

#[test]
fn nets_loaded_in_advance_start_one_after_the_other_from_where_the_arm_rests() {
    let cell = TestCell::demo();
    let rows = [("out", 0.1), ("on", 0.15), ("back", 0.0)];
    let ids = rows.map(|(name, y)| cell.load(&nets::line(name, y, 0.2)));
    for id in ids {
        let rehearsal = &cell.state(id)["rehearsal"];
        // At the time of LOAD the arm is at the goal of `back` already.
        let words = rehearsal["words"].as_str().unwrap_or_default();
        assert!(words.starts_with("checked: "), "{rehearsal}");
        cell.start_when_ready(id);
        cell.assert_ends(id, "finished");
    }
    cell.stop();
}

#[test]
fn a_net_that_would_violate_a_limit_is_rejected_with_motion_place_joint_and_remedy() {
    let cell = TestCell::demo();
    // The motion does not know that the net turns its joints as well.
    let text = nets::motion("hasty", 0.2, 0.1, nets::TURNED_AS_WELL)
        .replace("position: ik.joints", "position: turned.out");
    let (id, row) = cell.load_any(&text);
    assert_eq!(row["state"], "rejected", "{row}");
    let finding = &row["diagnostics"][0];
    assert_eq!(finding["code"], "RCC3023", "{row}");
    let words = finding["message"].as_str().unwrap_or_default();
    for part in [
        "in move at ",
        " % of the path",
        " m)",
        "lwr joint J",
        "exceeds",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    // At a lower speed the joint would leave its range: no speed is proposed.
    assert!(
        finding["help"]
            .as_str()
            .is_some_and(|help| help.contains("rcc-cli plot") && !help.contains("slower")),
        "{row}"
    );
    cell.rest("DELETE", &format!("/commands/{id}"), "");
    cell.stop();
}

#[test]
fn a_rejected_text_shows_its_diagnostics_by_id_later() {
    let cell = TestCell::demo();
    let text = nets::line("crooked", 0.1, 0.1).replace("pose: move.pose", "pose: move.poze");
    let (id, row) = cell.load_any(&text);
    assert_eq!(row["state"], "rejected", "{row}");
    let later = cell.state(id);
    let diagnostics = later["diagnostics"].as_array().expect("a list");
    let finding = diagnostics
        .iter()
        .find(|finding| {
            finding["rendered"]
                .as_str()
                .is_some_and(|text| text.contains("move.poze"))
        })
        .unwrap_or_else(|| panic!("{later}"));
    assert!(
        finding["code"]
            .as_str()
            .is_some_and(|code| code.starts_with("RCC1")),
        "{finding}"
    );
    assert!(
        finding["place"]["line"]
            .as_u64()
            .is_some_and(|line| line > 1),
        "{finding}"
    );
    assert!(
        finding["help"]
            .as_str()
            .is_some_and(|help| help.contains("move.pose")),
        "{finding}"
    );
    let refused = cell.operate(id, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3003"),
        "{refused:?}"
    );
    let path = cell.file(&text);
    let (_, errors) = cell.cli_exits(3, &["load", path.to_str().expect("plain")]);
    assert!(
        errors.contains("move.poze") && errors.contains("move.pose"),
        "{errors}"
    );
    cell.stop();
}

#[test]
fn two_nets_run_at_once_on_different_devices() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    let mut station = cell.simulator("io-sim");
    await_some("the lamp", || {
        (station.state()["coils"][0] == true).then_some(())
    });
    let both = cell.rest("GET", "/commands", "").body;
    let running = both
        .as_array()
        .expect("rows")
        .iter()
        .filter(|row| row["state"] == "running");
    assert_eq!(running.count(), 2, "{both}");
    cell.assert_ends(line, "finished");
    assert_eq!(
        cell.state(lamp)["state"],
        "running",
        "the other net keeps running"
    );
    cell.done(lamp, "cancel");
    cell.assert_ends(lamp, "canceled");
    await_some("the lamp to be released to its safe value", || {
        (station.state()["coils"][0] == false).then_some(())
    });
    cell.stop();
}

#[test]
fn a_canceled_line_comes_to_rest_on_its_path_and_the_next_net_continues_from_there() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    arm.await_motion();
    cell.cli_exits(8, &["cancel", "line", "--wait"]);
    let row = cell.state(line);
    assert_eq!(row["reason"], "canceled", "{row}");
    let rest = arm.await_rest();
    let [x, z] = [0, 2].map(|axis| rest["flange_position"][axis].as_f64().expect("a number"));
    assert!(
        (x - 0.5377).abs() < 1e-3 && (z - 0.3839).abs() < 1e-3,
        "on the line: {rest}"
    );
    let back = cell.run(&nets::line("back", 0.0, 0.1));
    cell.assert_ends(back, "finished");
    rcc_tests::simulator::assert_within_limits(&arm.state(), &[]);
    cell.stop();
}

#[test]
fn an_aborted_line_is_brought_to_rest_within_limits() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let line = cell.run(&nets::line("line", 0.2, 0.2));
    arm.await_motion();
    cell.cli_exits(0, &["abort", "line"]);
    cell.assert_ends(line, "aborted");
    let rest = arm.await_rest();
    rcc_tests::simulator::assert_within_limits(&rest, &[]);
    let back = cell.run(&nets::line("back", 0.0, 0.1));
    cell.assert_ends(back, "finished");
    cell.stop();
}

#[test]
fn tail_shows_every_cycle_of_a_motion_by_name_and_without_loss() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let watch =
        "  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: move.pose}}\n";
    let line = cell.load(&nets::motion("line", 0.1, 0.1, watch));
    let mut tail = cell
        .program("rcc-monitor")
        .args(["tail", "line/*", "lamp/clock.out", "--output", "json"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("rcc-monitor starts");
    let mut shown = BufReader::new(tail.stdout.take().expect("a pipe")).lines();
    let mut next = || -> Value {
        let line = shown.next().expect("another line").expect("UTF-8");
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{line}: {error}"))
    };
    let mut all = vec![next()];
    cell.start_when_ready(line);
    let number = |row: &Value, key: &str| {
        row[key]
            .as_u64()
            .unwrap_or_else(|| panic!("{key} in {row}"))
    };
    // Reads continuously: a monitor whose output is not read loses records.
    let row = await_some("the end of the line", || {
        all.extend((0..100).map(|_| next()));
        let row = cell.state(line);
        (row["state"] == "terminated").then_some(row)
    });
    assert_eq!(row["reason"], "finished", "{row}");
    let (first, last) = (number(&row, "started_cycle"), number(&row, "ended_cycle"));
    while number(&all[all.len() - 1], "cycle") <= last {
        all.push(next());
    }
    assert!(signal(tail.id(), Signal::SIGTERM));
    // The remaining output is read, so that the monitor does not fail because of a broken pipe.
    while shown.next().is_some() {}
    assert!(tail.wait().expect("rcc-monitor ends").success());
    for pair in all.windows(2) {
        assert_eq!(
            number(&pair[1], "sequence"),
            number(&pair[0], "sequence") + 1,
            "no record is missing: {pair:?}"
        );
    }
    let poses: Vec<&Value> = all
        .iter()
        .filter(|record| record["name"] == "line/move.pose")
        .collect();
    let cycles: Vec<u64> = poses.iter().map(|record| number(record, "cycle")).collect();
    assert_eq!(
        cycles,
        (first..=last).collect::<Vec<_>>(),
        "every cycle from START to the end"
    );
    assert!(poses.iter().all(|record| {
        record["value"]
            .as_array()
            .is_some_and(|pose| pose.len() == 7)
    }));
    cell.done(lamp, "cancel");
    cell.stop();
}
