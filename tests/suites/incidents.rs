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

/// Holds the arm until CANCEL.
const HOLD: &str = "net: hold
primitives:
  cancel: {type: Cancel}
  time: {type: Time}
  state: {type: JointState, parameters: {device: lwr}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: state.hold}}
  end: {type: Termination, inputs: {done: cancel.requested}}
discard: [state.position, time.out]
";

#[test]
fn an_armed_condition_records_the_seconds_before_it_became_true_once() {
    let cell = TestCell::demo();
    let hold = cell.load(HOLD);
    // Without the name of the net: only one has this output.
    let armed = json(&cell, &["incidents", "arm", "time.out > 1.5"]);
    let armed = armed["rules"][0]["rule"].to_string();
    // Conditions live in the executor.
    let dead = cell.kill(Role::Loader, "loader");
    cell.await_successor(Role::Loader, "loader", dead);
    let rows = json(&cell, &["incidents", "armed"]);
    assert_eq!(rows[0]["state"], "armed", "{rows}");
    assert_eq!(rows[0]["when"], "time.out > 1.5", "{rows}");
    cell.cli_exits(0, &["start", &hold.to_string()]);

    let row = incident(&cell, "trigger");
    assert_eq!(row["condition"], "time.out > 1.5", "{row}");
    let started = number(&cell.state(hold)["started_cycle"]);
    let at = number(&row["cycle"]);
    // 1.501 s is computed in the 1502nd evaluation, and judged in the cycle after it.
    assert_eq!(at, started + 1502, "{row}");
    assert!(number(&row["first_cycle"]) <= started, "{row}");
    assert!(number(&row["last_cycle"]) > at, "{row}");
    let file = row["file"].as_str().expect("a path");
    let result = json(&cell, &["replay", file]);
    assert_eq!(result["nets"][0]["identical"], true, "{result}");
    assert_eq!(result["rules"]["held"], 1, "{result}");
    assert_eq!(result["rules"]["reproduced"], 1, "{result}");

    let rows = json(&cell, &["incidents", "armed"]);
    assert_eq!(rows[0]["state"], "fired", "{rows}");
    assert_eq!(rows[0]["recorded"]["recordings"], 1, "{rows}");
    assert_eq!(rows[0]["recorded"]["cycle"], at, "{rows}");
    // The value stays above the limit, and nothing is recorded again: the next file is the one on request.
    json(&cell, &["incidents", "record"]);
    let all = json(&cell, &["incidents"]);
    assert_eq!(all.as_array().map(Vec::len), Some(2), "{all}");
    cell.cli_exits(0, &["incidents", "disarm", &armed]);
    assert_eq!(
        json(&cell, &["incidents", "armed"]),
        Value::Array(Vec::new())
    );
    cell.cli_exits(0, &["cancel", &hold.to_string()]);
    cell.await_end(hold);
    cell.stop();
}

#[test]
fn a_condition_that_cannot_be_judged_is_refused_with_what_to_do() {
    let cell = TestCell::demo();
    let (_, words) = cell.cli_exits(1, &["incidents", "disarm", "7"]);
    assert!(words.contains("RCC3052"), "{words}");
    let refused = |condition: &str| cell.cli_exits(3, &["incidents", "arm", condition]).1;
    let words = refused("time.out > 1.5");
    assert!(
        words.contains("RCC3051") && words.contains("load the net"),
        "{words}"
    );
    cell.load(HOLD);
    cell.load(&HOLD.replace("net: hold", "net: other"));
    for (condition, help) in [
        ("time.out > 1.5", "NET.time.out"),
        ("hold.time.oout > 1.5", "did you mean `out`"),
        ("hold.tme.out > 1.5", "did you mean `time`"),
        ("hold.time.out > 1.5 s", "`and`"),
        ("hold.time.out", "compare it"),
        ("hold.state.hold > 1", "state.hold[0]"),
        ("hold.state.hold[7] > 1", "0 to 6"),
        ("hold.cancel.requested > 1", "not hold.cancel.requested"),
    ] {
        let words = refused(condition);
        assert!(words.contains("RCC3051") && words.contains(help), "{words}");
    }
    assert_eq!(
        json(&cell, &["incidents", "armed"]),
        Value::Array(Vec::new())
    );
    // A rule that acts is none of these, and is not removed as one.
    let rule =
        serde_json::json!({"rules": [{"when": "hold.state == terminated", "stop": "other"}]});
    let reply = cell.rest("POST", "/rules", &rule.to_string());
    assert_eq!(reply.status, 200, "{reply:?}");
    let rule = reply.body["rules"][0]["rule"].to_string();
    let (_, words) = cell.cli_exits(2, &["incidents", "disarm", &rule]);
    assert!(words.contains("rules remove"), "{words}");
    cell.stop();
}
