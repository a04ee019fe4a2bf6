//! Incident files of real cells: a fault or a request writes one, and `rcc-cli replay` reproduces it bit for bit. Run
//! by the threads of the test harness.

use std::fs;

use rcc_protocol::Role;
use rcc_tests::{CellFixture, TestCell, await_some, nets};
use serde_json::Value;

fn json(cell: &CellFixture, arguments: &[&str]) -> Value {
    let all = [&["--output", "json"][..], arguments].concat();
    let (out, _) = cell.cli_exits(0, &all);
    serde_json::from_str(&out).expect("one JSON value")
}

/// Waits for the first incident with this reason.
fn incident(cell: &CellFixture, reason: &str) -> Value {
    await_some(&format!("an incident ({reason})"), || {
        let all = json(cell, &["incidents"]);
        let rows = all.as_array().expect("a list").clone();
        rows.into_iter().find(|row| row["reason"] == reason)
    })
}

fn number(value: &Value) -> u64 {
    value
        .as_u64()
        .unwrap_or_else(|| panic!("{value} is a number"))
}

#[test]
fn a_killed_driver_leaves_an_incident_that_is_replayed_bit_for_bit() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    cell.simulator("lwr-sim").await_motion();
    let dead = cell.announced(Role::Driver, "lwr");
    cell.cli_exits(0, &["fault", "driver/lwr", "kill"]);
    let ended = cell.await_end(line);
    cell.await_successor(Role::Driver, "lwr", dead.incarnation);

    let row = incident(&cell, "fault");
    assert_eq!(row["name"], format!("line#{line}"), "{row}");
    assert_eq!(row["fault"], "device lost: lwr");
    assert_eq!(row["cycle"], ended["fault"]["cycle"]);
    let file = row["file"].as_str().expect("a path");

    let result = json(&cell, &["replay", file]);
    let net = &result["nets"][0];
    assert_eq!(net["net"], format!("line#{line}"));
    assert_eq!(
        (&net["identical"], &net["mismatch"]),
        (&true.into(), &Value::Null),
        "{result}"
    );
    assert_eq!(
        net["compared"], ended["cycles"],
        "every cycle from START to the fault"
    );

    let table = cell.folder().join("values.csv");
    let path = table.to_str().expect("a path");
    cell.cli_exits(
        0,
        &["replay", file, "--show", "line/move.pose", "--csv", path],
    );
    let text = fs::read_to_string(&table).expect("it was written");
    let mut lines = text.lines();
    assert_eq!(lines.next().map(|head| head.split(',').count()), Some(9));
    assert_eq!(lines.count() as u64, number(&net["compared"]));

    let until = number(&row["cycle"]) - 10;
    let part = json(&cell, &["replay", file, "--until", &until.to_string()]);
    assert_eq!(number(&part["nets"][0]["last_cycle"]), until);

    let log_text = await_some("the incident in the log", || {
        let (log, _) = cell.cli_exits(0, &["events"]);
        log.contains("rcc-cli replay").then_some(log)
    });
    assert!(log_text.contains("incident (fault)"), "{log_text}");
    cell.stop();
}

#[test]
fn an_incident_on_request_contains_the_running_net_and_a_damaged_copy_is_refused() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.01));
    let row = json(&cell, &["incidents", "record"]);
    assert_eq!(row["reason"], "request");
    let file = row["file"].as_str().expect("a path");
    let result = json(&cell, &["replay", file]);
    assert_eq!(result["nets"][0]["identical"], true, "{result}");
    assert!(number(&result["nets"][0]["compared"]) > 0);
    assert_eq!(
        json(&cell, &["incidents"]).as_array().map(Vec::len),
        Some(1)
    );
    // The second recording does not contain the beginning of the first one, so it begins with a snapshot.
    let second = json(&cell, &["incidents", "record"]);
    let file = second["file"].as_str().expect("a path");
    let result = json(&cell, &["replay", file]);
    assert_eq!(result["nets"][0]["identical"], true, "{result}");
    assert!(number(&result["nets"][0]["compared"]) > 0, "{result}");
    let mut bytes = fs::read(file).expect("the file");
    let copy = cell.folder().join("copy");
    let path = copy.to_str().expect("a path");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(&copy, &bytes).expect("a copy");
    let (_, words) = cell.cli_exits(3, &["replay", path]);
    assert!(
        words.contains("RCC4030") && words.contains("checksum"),
        "{words}"
    );
    bytes.truncate(middle);
    fs::write(&copy, &bytes).expect("a copy");
    cell.cli_exits(3, &["replay", path]);
    fs::write(&copy, "net: line").expect("a copy");
    cell.cli_exits(3, &["replay", path]);
    cell.cli_exits(0, &["abort", &line.to_string()]);
    cell.await_end(line);
    cell.stop();
}

#[test]
fn a_cell_without_a_recorder_refuses_to_record() {
    let without = |text: String| text.replacen("period:", "recorder: {memory: 0 MB}\nperiod:", 1);
    let cell = TestCell::changed(without);
    let (_, words) = cell.cli_exits(5, &["incidents", "record"]);
    assert!(words.contains("RCC3030"), "{words}");
    cell.stop();
}

#[test]
fn a_recording_that_cannot_be_written_is_an_error() {
    let cell = TestCell::demo();
    // A file in its place: nobody can create a folder there, not even root.
    let blocked = cell.cell().state().incidents_dir();
    fs::write(&blocked, "").expect("a file");
    let reply = cell.rest("POST", "/incidents", "");
    assert_eq!(reply.status, 500, "{:?}", reply.body);
    assert_eq!(reply.body["code"], "RCC4008", "{:?}", reply.body);
    let words = reply.body["message"].as_str().unwrap_or_default();
    assert!(words.contains(&blocked.display().to_string()), "{words}");
    cell.stop();

    let cell = TestCell::demo();
    let reply = cell.rest("POST", "/incidents", "");
    assert_eq!(reply.status, 200, "{:?}", reply.body);
    let file = reply.body["file"].as_str().expect("a path");
    assert!(
        fs::metadata(file).is_ok_and(|file| file.len() > 0),
        "{file}"
    );
    cell.stop();
}
