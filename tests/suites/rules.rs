//! Rules through all processes: what follows begins in the next cycle; a person's stop, a client that is gone and a killed
//! loader start nothing. Each test has a cell of its own.

use rcc_protocol::Role;
use rcc_tests::programs::repository;
use rcc_tests::{TestCell, await_some};
use serde_json::{Value, json};

/// Holds the arm for this time and ends.
fn hold_for(net: &str, time: &str) -> String {
    format!(
        "net: {net}
primitives:
  cancel: {{type: Cancel}}
  time: {{type: Time}}
  over: {{type: Greater, inputs: {{a: time.out, b: {time}}}}}
  state: {{type: JointState, parameters: {{device: lwr}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: state.hold}}}}
  end: {{type: Termination, inputs: {{done: {{over: over.out, stopped: cancel.requested}}}}}}
discard: [state.position]
"
    )
}

/// Moves the arm to a goal, from wherever and however it moves; `near` is true after this time.
fn go_on(net: &str, joint1: &str, time: &str) -> String {
    format!(
        "net: {net}
primitives:
  cancel: {{type: Cancel}}
  time: {{type: Time}}
  near: {{type: Greater, inputs: {{a: time.out, b: {time}}}}}
  move:
    type: JointGoal
    parameters: {{device: lwr, scale: 0.3, start: continue}}
    inputs: {{goal: [{joint1}, deg(-30), 0, deg(90), 0, deg(-60), 0], stop: cancel.requested}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: move.position}}}}
  end: {{type: Termination, inputs: {{done: {{there: move.done}}}}}}
discard: [near.out]
"
    )
}

/// Goes 0.1 m down along a line; `far` is true after 30 mm.
const LINE: &str = "net: line
primitives:
  cancel: {type: Cancel}
  move:
    type: LinearMotion
    parameters: {device: lwr, to: {xyz: [0.538, 0, 0.284], rpy: [0, deg(180), 0]}, velocity: 50 mm/s}
    inputs: {stop: cancel.requested}
  far: {type: Formula, parameters: {expr: move.distance > 30 mm}}
  z: {type: Formula, parameters: {expr: move.pose.z}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: move.joints}}
  end: {type: Termination, inputs: {done: {there: move.done}}}
discard: [far.out, z.out]
";

/// Goes 40 mm up from wherever and however the flange moves; `range` has the lowest height.
const RETREAT: &str = "net: retreat
primitives:
  cancel: {type: Cancel}
  here: {type: StartPose, parameters: {device: lwr, start: continue}}
  above: {type: Compose, inputs: {a: {xyz: [0, 0, 40 mm], rpy: [0, 0, 0]}, b: here.pose}}
  move:
    type: PoseGoal
    parameters: {device: lwr, velocity: 0.1 m/s, acceleration: 0.5 m/s^2, jerk: 5 m/s^3, start: continue}
    inputs: {goal: above.out, stop: cancel.requested}
  begins: {type: Formula, parameters: {expr: here.pose.z}}
  z: {type: Formula, parameters: {expr: move.pose.z}}
  range: {type: PeakHold, inputs: {in: z.out}}
  ik: {type: InverseKinematics, parameters: {device: lwr, start: continue}, inputs: {pose: move.pose}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: ik.joints}}
  end: {type: Termination, inputs: {done: {there: move.done}}}
discard: [begins.out]
";

fn number(cell: &TestCell, id: u64, port: &str) -> f64 {
    let reply = cell.rest("GET", &format!("/commands/{id}/values?ports={port}"), "");
    let value = reply.body["values"][0]["value"].as_f64();
    value.unwrap_or_else(|| panic!("{port}: {reply:?}"))
}

fn install(cell: &TestCell, body: &Value) -> Value {
    let reply = cell.rest("POST", "/rules", &body.to_string());
    assert_eq!(reply.status, 200, "{reply:?}\n{}", cell.logs());
    reply.body
}

fn state_of(cell: &TestCell, rule: u64) -> Value {
    cell.rest("GET", &format!("/rules/{rule}"), "").body
}

fn await_state(cell: &TestCell, rule: u64, state: &str) -> Value {
    await_some(&format!("rule {rule} to be {state}"), || {
        let row = state_of(cell, rule);
        (row["state"] == state).then_some(row)
    })
}

fn await_running(cell: &TestCell, id: u64) -> Value {
    await_some("the command to run", || {
        let row = cell.state(id);
        (row["state"] == "running").then_some(row)
    })
}

#[test]
fn a_chain_of_rules_hands_the_arm_over_in_flight_without_a_cycle_in_between() {
    let cell = TestCell::demo();
    let first = cell.load(&go_on("one", "deg(20)", "0.4 s"));
    let second = cell.load(&go_on("two", "deg(-20)", "0.4 s"));
    let third = cell.load(&go_on("three", "0", "100 s"));
    let body = json!({"rules": [
        {"when": "one.near.out", "stop": "one", "start": "two", "on_client_loss": "go on"},
        {"name": "back", "when": "two.near.out", "stop": "two", "start": ["three"], "on_client_loss": "go on"},
        {"name": "never", "when": "three.outcome == there and one.outcome == there", "cancel": "three"},
    ]});
    install(&cell, &body);
    cell.done(first, "start");
    cell.assert_ends(third, "finished");
    let rows = [first, second, third].map(|id| cell.state(id));
    for pair in rows.windows(2) {
        let (ended, began) = (&pair[0]["ended_cycle"], &pair[1]["started_cycle"]);
        assert_eq!(
            ended.as_u64().map(|cycle| cycle + 1),
            began.as_u64(),
            "{rows:?}"
        );
    }
    for rule in [1, 2] {
        let row = await_state(&cell, rule, "fired");
        assert_eq!(row["cycle"], rows[rule as usize]["started_cycle"], "{row}");
    }
    assert_eq!(await_state(&cell, 3, "expired")["name"], "never");
    let (out, _) = cell.cli_exits(0, &["rules", "ls"]);
    assert!(out.contains("back") && out.contains("fired"), "{out}");
    let (events, _) = cell.cli_exits(0, &["events"]);
    assert!(events.contains("rule 1 fired"), "{events}");
    cell.stop();
}

#[test]
fn a_motion_of_the_flange_begins_where_a_rule_stops_a_line_in_flight() {
    let cell = TestCell::demo();
    let [line, retreat] = [LINE, RETREAT].map(|net| cell.load(net));
    let rule = json!({
        "when": "line.far.out", "stop": "line", "start": "retreat", "on_client_loss": "go on",
    });
    install(&cell, &json!({"rules": [rule]}));
    cell.done(line, "start");
    cell.assert_ends(retreat, "finished");
    let (left, began) = (cell.state(line), cell.state(retreat));
    let last = left["ended_cycle"].as_u64().map(|cycle| cycle + 1);
    assert_eq!(last, began["started_cycle"].as_u64(), "{left} {began}");
    // It begins at the last set-point of the line, goes on downwards while it brakes, and ends where it wants to.
    let end = number(&cell, line, "z.out");
    let [begin, lowest, top] =
        ["begins.out", "range.least", "z.out"].map(|port| number(&cell, retreat, port));
    assert!((begin - end).abs() < 1e-9, "{begin} {end}");
    assert!(begin - lowest > 1e-4 && begin - lowest < 0.01, "{lowest}");
    assert!((top - begin - 0.04).abs() < 1e-9, "{top}");
    cell.stop();
}

#[test]
fn a_cancel_by_a_person_disarms_what_would_start_the_arm_after_it() {
    let cell = TestCell::demo();
    let first = cell.run(&hold_for("first", "1000 s"));
    let second = cell.load(&hold_for("second", "1 s"));
    let lease = cell.rest("POST", "/leases", r#"{"expires_ms": 60000}"#);
    assert_eq!(lease.status, 200, "{lease:?}");
    let rule = json!({"when": "first.reason == canceled", "start": "second"});
    let refused = cell.rest("POST", "/rules", &json!({"rules": [rule]}).to_string());
    assert_eq!(
        (refused.status, &refused.body["code"]),
        (409, &json!("RCC3050"))
    );
    install(
        &cell,
        &json!({"rules": [rule], "lease": lease.body["lease"]}),
    );
    cell.done(first, "cancel");
    cell.assert_ends(first, "canceled");
    let row = await_state(&cell, 1, "disarmed");
    assert!(
        row["words"]
            .as_str()
            .is_some_and(|words| words.contains("first#")),
        "{row}"
    );
    assert_eq!(cell.state(second)["state"], "ready");
    cell.stop();
}

#[test]
fn a_client_that_is_gone_starts_no_arm_and_what_it_started_is_canceled() {
    let cell = TestCell::demo();
    let held = cell.load(&hold_for("held", "1000 s"));
    let second = cell.load(&hold_for("second", "1 s"));
    let lease = cell.rest("POST", "/leases", r#"{"expires_ms": 1500}"#);
    let lease = lease.body["lease"].as_u64().expect("a lease");
    let body = json!({
        "lease": lease,
        "rules": [{"when": "held.outcome == stopped", "start": "second"}],
    });
    let reply = cell.rest(
        "POST",
        &format!("/commands/{held}/start"),
        &body.to_string(),
    );
    assert_eq!(reply.status, 200, "{reply:?}");
    for _ in 0..3 {
        let renewed = cell.rest("POST", &format!("/leases/{lease}/renew"), "");
        assert_eq!(renewed.status, 200, "{renewed:?}");
    }
    // Nobody renews it any more.
    cell.assert_ends(held, "canceled");
    let row = await_state(&cell, 1, "disarmed");
    assert!(
        row["words"]
            .as_str()
            .is_some_and(|words| words.contains("lease")),
        "{row}"
    );
    assert_eq!(cell.state(second)["state"], "ready");
    let lost = cell.rest("POST", &format!("/leases/{lease}/renew"), "");
    assert_eq!((lost.status, &lost.body["code"]), (404, &json!("RCC3053")));
    cell.stop();
}

#[test]
fn rules_live_in_the_executor_while_the_loader_is_killed_and_restarted() {
    let cell = TestCell::demo();
    let first = cell.load(&hold_for("first", "4 s"));
    let second = cell.load(&hold_for("second", "1000 s"));
    let rule = json!({
        "name": "and on", "when": "first.outcome == over", "start": "second", "on_client_loss": "go on",
    });
    install(&cell, &json!({"rules": [rule]}));
    cell.done(first, "start");
    let dead = cell.kill(Role::Loader, "loader");
    cell.await_successor(Role::Loader, "loader", dead);
    let began = await_running(&cell, second);
    let ended = cell.state(first)["ended_cycle"].as_u64();
    assert_eq!(
        ended.map(|cycle| cycle + 1),
        began["started_cycle"].as_u64()
    );
    let row = await_state(&cell, 1, "fired");
    assert_eq!((&row["name"], &row["when"]), (&rule["name"], &rule["when"]));
    cell.done(second, "cancel");
    cell.stop();
}

#[test]
fn a_task_of_nets_and_rules_runs_to_its_end_and_is_replayed() {
    let cell = TestCell::demo();
    let task = repository().join("configs/tasks/blink-twice.yaml");
    let task = task.to_str().expect("a text");
    let (out, _) = cell.cli_exits(0, &["task", "--keep", task]);
    assert!(out.contains("`and again`  fired in cycle"), "{out}");
    let recorded = cell.rest("POST", "/incidents", "");
    assert_eq!(recorded.status, 200, "{recorded:?}");
    let file = recorded.body["file"].as_str().expect("a file").to_owned();
    let (replayed, _) = cell.cli_exits(0, &["replay", &file]);
    assert!(
        replayed.contains("1 of 1 that held reproduced"),
        "{replayed}"
    );
    cell.stop();
}
