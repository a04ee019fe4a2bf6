//! The event log of a cell, and injected faults: each test has a cell of its own, injects faults with `rcc-cli fault`,
//! and asserts that `rcc-cli events` reports them completely. Run by the threads of the test harness.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use rcc_protocol::Role;
use rcc_tests::{CellFixture, TestCell, await_some, nets, repository};
use serde_json::Value;

/// Returns the events of the log as JSON.
fn events(cell: &CellFixture, arguments: &[&str]) -> Vec<Value> {
    let all = [&["--output", "json", "events"][..], arguments].concat();
    let (out, _) = cell.cli_exits(0, &all);
    let lines = out.lines().map(serde_json::from_str);
    lines.collect::<Result<_, _>>().expect("one object a line")
}

/// Waits for the first event for which `is` returns true; returns the event.
fn await_event(cell: &CellFixture, what: &str, is: impl Fn(&Value) -> bool) -> Value {
    await_some(&format!("an event: {what}"), || {
        events(cell, &[]).into_iter().find(|event| is(event))
    })
}

fn of_kind<'a>(kind: &'a str, field: &'a str, value: &'a str) -> impl Fn(&Value) -> bool + 'a {
    move |event| event["kind"] == kind && event["fields"][field] == value
}

/// Returns the index of the first event for which `is` returns true.
fn index_of(events: &[Value], is: impl Fn(&Value) -> bool) -> usize {
    let found = events.iter().position(is);
    found.unwrap_or_else(|| panic!("the event is not in the log: {events:#?}"))
}

#[test]
fn a_killed_driver_is_reported_by_every_process_that_it_concerns() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    cell.simulator("lwr-sim").await_motion();
    let dead = cell.announced(Role::Driver, "lwr");
    cell.cli_exits(0, &["fault", "driver/lwr", "kill"]);
    cell.await_end(line);
    cell.await_successor(Role::Driver, "lwr", dead.incarnation);
    cell.await_device("lwr", "ready");

    let found = await_event(&cell, "the device is found again", |event| {
        let life = format!("{:016x}", dead.incarnation);
        of_kind("device-found", "device", "lwr")(event)
            && event["fields"]["driver"] != life.as_str()
    });
    let all = events(&cell, &[]);
    let cause = index_of(&all, of_kind("fault-injected", "target", "driver/lwr"));
    let lost = index_of(&all, of_kind("device-lost", "device", "lwr"));
    let ended = index_of(&all, |event| event["fields"]["reason"] == "fault");
    let died = index_of(&all, of_kind("process-died", "process", "driver/lwr"));
    let again = index_of(&all, of_kind("process-restart", "process", "driver/lwr"));
    assert!(cause < lost && lost <= ended && died < again, "{all:#?}");
    assert_eq!(all[died]["fields"]["how"], "SIGKILL");
    assert_eq!(all[died]["fields"]["pid"], dead.pid);
    assert_eq!(
        all[lost]["cycle"], all[ended]["cycle"],
        "both events are of the same cycle"
    );
    assert!(all[lost]["cycle"].as_u64() < found["cycle"].as_u64());
    assert_eq!(all[ended]["net"], format!("line#{line}"));
    assert_eq!(all[ended]["fields"]["fault"]["code"], "device lost");
    assert_eq!(all[ended]["fields"]["fault"]["device"], "lwr");
    let started = await_event(
        &cell,
        "the successor to name its dead predecessor",
        |event| event["kind"] == "started" && event["fields"]["predecessor"]["pid"] == dead.pid,
    );
    assert_eq!(started["source"]["label"], "lwr");
    index_of(&all, |event| event["kind"] == "cleaned");

    // The filters: by device, by net, and from a cycle on.
    let of_io = events(&cell, &["--device", "io"]);
    assert!(of_io.iter().all(|event| event["kind"] != "device-lost"));
    let of_net = events(&cell, &["--net", "line"]);
    assert!(of_net.iter().any(|event| event["kind"] == "loaded"));
    let cycle = all[lost]["cycle"].to_string();
    let since = events(&cell, &["--since", &cycle]);
    assert_eq!(since[0]["cycle"], all[lost]["cycle"], "{since:#?}");
    let (table, _) = cell.cli_exits(0, &["events"]);
    assert!(
        table.contains("terminated by a fault, device lost: lwr"),
        "{table}"
    );
    cell.stop();
}

#[test]
fn the_log_is_read_and_followed_while_loader_and_executor_are_dead() {
    let mut cell = TestCell::demo();
    let mut command = cell.program("rcc-cli");
    command.args(["--output", "json", "events", "--follow"]);
    let mut follower = command
        .stdout(Stdio::piped())
        .spawn()
        .expect("rcc-cli starts");
    let mut lines = BufReader::new(follower.stdout.take().expect("a pipe")).lines();
    cell.kill_supervisor();
    // The child processes end with their supervisor, each in an orderly way.
    let stops = lines.find(|line| {
        let line = line.as_ref().expect("whole lines");
        line.contains("\"stopping\"") && line.contains("\"executor\"")
    });
    assert!(stops.is_some(), "the follower ended");
    follower.kill().expect("the child is ours");
    follower.wait().expect("the child is ours");
    cell.await_dead();
    let all = events(&cell, &[]);
    index_of(&all, |event| event["kind"] == "cell-started");

    cell.up_again();
    let all = events(&cell, &[]);
    let starts = all.iter().filter(|event| event["kind"] == "cell-started");
    let previous: Vec<bool> = starts
        .map(|event| event["fields"]["previous"].is_object())
        .collect();
    assert_eq!(
        previous,
        [false, true],
        "the second start follows one that did not end in an orderly way"
    );
    cell.stop();
}

#[test]
fn every_fault_of_the_arm_takes_effect_and_can_be_cleared() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    cell.cli_exits(0, &["fault", "lwr", "force", "0", "0", "20"]);
    assert_eq!(arm.state()["wrench"][2], 20.0);
    cell.cli_exits(
        0,
        &[
            "fault", "lwr", "wall", "--point", "0", "0", "-1", "--normal", "0", "0", "1",
        ],
    );
    assert!(arm.state()["wall"].is_object());
    cell.cli_exits(0, &["fault", "lwr", "loss", "10%", "--direction", "to-pc"]);
    await_some("a lost measurement", || {
        (arm.state()["network"]["to_pc"]["lost"].as_u64()? > 0).then_some(())
    });
    cell.cli_exits(
        0,
        &[
            "fault",
            "lwr",
            "network",
            "--duplicated",
            "20%",
            "--corrupted",
            "5%",
        ],
    );
    await_some("a corrupted answer", || {
        (arm.state()["network"]["from_pc"]["corrupted"].as_u64()? > 0).then_some(())
    });
    cell.cli_exits(0, &["fault", "clear", "lwr"]);
    let state = arm.state();
    assert_eq!(
        (&state["wrench"][2], state["wall"].is_null()),
        (&Value::from(0.0), true)
    );
    cell.await_device("lwr", "ready");

    cell.cli_exits(0, &["fault", "lwr", "freeze", "500ms"]);
    cell.await_device("lwr", "offline");
    await_event(
        &cell,
        "the device is lost",
        of_kind("device-lost", "device", "lwr"),
    );
    cell.cli_exits(0, &["fault", "clear", "lwr"]);
    cell.await_device("lwr", "ready");
    for fault in [&["estop"][..], &["drives", "off"]] {
        cell.cli_exits(0, &[&["fault", "lwr"][..], fault].concat());
        cell.await_device("lwr", "online");
        cell.cli_exits(0, &["fault", "clear", "lwr"]);
        cell.await_device("lwr", "ready");
    }
    cell.stop();
}

#[test]
fn a_station_that_does_not_answer_and_a_stopped_process_are_reported() {
    let cell = TestCell::demo();
    cell.cli_exits(0, &["fault", "io", "freeze", "2s"]);
    cell.await_device("io", "offline");
    cell.cli_exits(0, &["fault", "clear", "io"]);
    cell.await_device("io", "ready");
    cell.cli_exits(0, &["fault", "driver/io", "stop"]);
    cell.await_device("io", "offline");
    let lost = await_event(&cell, "io fell silent", |event| {
        of_kind("device-lost", "device", "io")(event) && event["fields"]["board_age_us"].is_u64()
    });
    assert!(
        lost["words"]
            .as_str()
            .is_some_and(|words| words.contains("ms")),
        "{lost}"
    );
    cell.cli_exits(0, &["fault", "driver/io", "continue"]);
    cell.await_device("io", "ready");
    cell.stop();
}

#[test]
fn faults_are_not_injected_into_a_device_that_is_not_simulated() {
    let cell = TestCell::changed(|text| text.replace("    device: io\n", ""));
    let (_, refusal) = cell.cli_exits(7, &["fault", "io", "drop", "3"]);
    assert!(refusal.contains("not simulated"), "{refusal}");
    let (_, refusal) = cell.cli_exits(7, &["fault", "executor", "kill"]);
    assert!(refusal.contains("io"), "{refusal}");
    cell.cli_exits(0, &["fault", "lwr", "force", "0", "0", "0"]);
    cell.stop();
}

#[test]
fn a_rejected_net_is_reported_with_its_code() {
    let cell = TestCell::demo();
    let (id, row) = cell.load_any("net: wrong\nprimitives: {a: {type: Nothing}}\n");
    assert_eq!(row["state"], "rejected");
    let event = await_event(&cell, "a refusal", |event| event["kind"] == "rejected");
    assert_eq!(event["fields"]["command"], id);
    let words = event["words"].as_str().expect("words");
    assert!(
        words.starts_with(&format!("wrong#{id} rejected: RCC")),
        "{words}"
    );
    cell.stop();
}

#[test]
fn the_docs_name_every_effect() {
    let text = std::fs::read_to_string(repository().join("docs/events.md")).expect("a file");
    for effect in [
        "wall",
        "force",
        "loss",
        "network",
        "freeze",
        "estop",
        "drives",
        "exception",
        "delay",
        "drop",
        "kill",
        "segv",
        "stop",
        "continue",
        "exit",
        "clear",
    ] {
        assert!(text.contains(effect), "{effect}");
    }
}
