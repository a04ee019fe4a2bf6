//! CANCEL, ABORT and a kill of the loader in each phase of a rule: installed, its command running, just fired, its net
//! moving. A person's stop is final in each of them; without the loader the executor does what was agreed, once, and
//! nothing starts again. Each test has a cell of its own.

use rcc_protocol::Role;
use rcc_tests::{TestCell, await_some};
use serde_json::{Value, json};

/// When the interruption comes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// The rule is installed; the command that it waits for is loaded.
    Installed,
    /// That command is running, and its arm moves.
    Running,
    /// The rule has just fired.
    Fired,
    /// The net that it started has moved the arm for a while.
    Moving,
}

const PHASES: [Phase; 4] = [
    Phase::Installed,
    Phase::Running,
    Phase::Fired,
    Phase::Moving,
];

/// Moves the arm to a goal and stays there until CANCEL; `go.value` is set from outside, `moved.out` is true after 0.2 s.
fn moving(net: &str, joint1: &str) -> String {
    format!(
        "net: {net}
primitives:
  cancel: {{type: Cancel}}
  go: {{type: Input, parameters: {{initial: false}}}}
  time: {{type: Time}}
  moved: {{type: Greater, inputs: {{a: time.out, b: 0.2 s}}}}
  move:
    type: JointGoal
    parameters: {{device: lwr, scale: 0.1, start: continue}}
    inputs: {{goal: [{joint1}, deg(-30), 0, deg(90), 0, deg(-60), 0], stop: cancel.requested}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: move.position}}}}
  stopped: {{type: And, inputs: {{a: cancel.requested, b: move.done}}}}
  end: {{type: Termination, inputs: {{done: {{stopped: stopped.out}}}}}}
discard: [go.value, moved.out]
"
    )
}

/// The commands of one case.
struct Case {
    first: u64,
    second: u64,
    rule: u64,
}

/// Installs the rule, and goes on until `phase` is reached.
fn reach(cell: &TestCell, phase: Phase, round: usize) -> Case {
    let sides = ["deg(10)", "deg(-10)"];
    let first = cell.load(&moving("first", sides[round % 2]));
    let second = cell.load(&moving("second", sides[(round + 1) % 2]));
    let rule = json!({
        "when": format!("#{first}.go.value"), "stop": first, "start": second, "on_client_loss": "go on",
    });
    let reply = cell.rest("POST", "/rules", &json!({"rules": [rule]}).to_string());
    assert_eq!(reply.status, 200, "{reply:?}\n{}", cell.logs());
    let rule = reply.body["rules"][0]["rule"].as_u64().expect("an id");
    let case = Case {
        first,
        second,
        rule,
    };
    if phase != Phase::Installed {
        cell.start_when_ready(first);
        await_moved(cell, first);
    }
    if matches!(phase, Phase::Fired | Phase::Moving) {
        set_go(cell, first);
        await_rule(cell, rule, "fired");
    }
    if phase == Phase::Moving {
        await_moved(cell, second);
    }
    case
}

fn set_go(cell: &TestCell, id: u64) {
    let path = format!("/commands/{id}/inputs");
    await_some("the input to be set", || {
        let reply = cell.try_rest("PUT", &path, r#"{"go": true}"#)?;
        (reply.status == 200).then_some(())
    });
}

fn await_moved(cell: &TestCell, id: u64) {
    await_some("the arm to move", || {
        let row = cell.state(id);
        let since = row["started_cycle"].as_u64()?;
        (row["state"] == "running" && cell.watch().status().cycle > since + 200).then_some(())
    });
}

fn rule_row(cell: &TestCell, rule: u64) -> Option<Value> {
    let reply = cell.try_rest("GET", &format!("/rules/{rule}"), "")?;
    (reply.status == 200).then_some(reply.body)
}

fn await_rule(cell: &TestCell, rule: u64, state: &str) -> Value {
    await_some(&format!("rule {rule} to be {state}"), || {
        rule_row(cell, rule).filter(|row| row["state"] == state)
    })
}

/// Nothing is running, and the arm is not commanded: nothing starts again, for some hundred cycles.
fn assert_at_rest(cell: &TestCell, case: &Case) {
    cell.await_devices();
    let is_free = || Some(cell.device("lwr")?["holder"].is_null());
    await_some("the arm to be commanded by no net", || {
        is_free()?.then_some(())
    });
    let states = || [case.first, case.second].map(|id| cell.state(id)["state"].clone());
    let at_rest = states();
    let rests = |state: &Value| state == "ready" || state == "terminated";
    assert!(at_rest.iter().all(rests), "{at_rest:?}");
    let watch = cell.watch();
    let begun = watch.status().cycle;
    await_some("some hundred cycles", || {
        assert_eq!(states(), at_rest, "a net started again");
        assert!(is_free()?, "a net commands the arm again");
        (watch.status().cycle > begun + 300).then_some(())
    });
}

fn unload(cell: &TestCell, case: &Case) {
    for id in [case.first, case.second] {
        let reply = cell.rest("DELETE", &format!("/commands/{id}"), "");
        assert_eq!(reply.status, 200, "{reply:?}");
    }
}

/// A stop by a person in each phase; `reason` is how the running command ends.
fn stopped_by_a_person(operation: &str, reason: &str) {
    let cell = TestCell::demo();
    for (round, phase) in PHASES.into_iter().enumerate() {
        let case = reach(&cell, phase, round);
        let has_fired = matches!(phase, Phase::Fired | Phase::Moving);
        let running = if has_fired { case.second } else { case.first };
        let reply = cell.operate(running, operation);
        if phase == Phase::Installed {
            // Whatever the answer for a command that does not run: the wish counts.
            await_rule(&cell, case.rule, "disarmed");
            cell.await_devices();
        } else {
            assert_eq!(reply.status, 200, "{phase:?}: {reply:?}");
            cell.assert_ends(running, reason);
            let state = if has_fired { "fired" } else { "disarmed" };
            await_rule(&cell, case.rule, state);
        }
        assert_at_rest(&cell, &case);
        let second = cell.state(case.second)["state"].clone();
        assert_eq!(
            second,
            if has_fired { "terminated" } else { "ready" },
            "{phase:?}"
        );
        unload(&cell, &case);
    }
    cell.stop();
}

#[test]
fn a_cancel_in_any_phase_of_a_rule_is_final() {
    stopped_by_a_person("cancel", "canceled");
}

#[test]
fn an_abort_in_any_phase_of_a_rule_is_final() {
    stopped_by_a_person("abort", "aborted");
}

#[test]
fn a_rule_fires_once_whenever_the_loader_is_killed() {
    let cell = TestCell::demo();
    for (round, phase) in PHASES.into_iter().enumerate() {
        let case = reach(&cell, phase, round);
        let dead = cell.kill(Role::Loader, "loader");
        cell.await_successor(Role::Loader, "loader", dead);
        let row = await_some("the rules after the restart", || rule_row(&cell, case.rule));
        let has_fired = matches!(phase, Phase::Fired | Phase::Moving);
        assert_eq!(
            row["state"],
            if has_fired { "fired" } else { "armed" },
            "{phase:?}"
        );
        if phase == Phase::Installed {
            cell.start_when_ready(case.first);
        }
        if !has_fired {
            await_moved(&cell, case.first);
            set_go(&cell, case.first);
        }
        let fired = await_rule(&cell, case.rule, "fired")["cycle"].as_u64();
        await_moved(&cell, case.second);
        let (first, second) = (cell.state(case.first), cell.state(case.second));
        assert_eq!(second["started_cycle"].as_u64(), fired, "{phase:?}");
        let last = fired.and_then(|cycle| cycle.checked_sub(1));
        assert_eq!(first["ended_cycle"].as_u64(), last, "{phase:?}");
        cell.done(case.second, "cancel");
        cell.assert_ends(case.second, "canceled");
        assert_at_rest(&cell, &case);
        unload(&cell, &case);
    }
    cell.stop();
}

#[test]
fn a_net_of_a_rule_that_faults_starts_only_what_waits_for_the_fault() {
    let cell = TestCell::demo();
    let first = cell.load(&moving("first", "deg(10)"));
    // Its set-point jumps when `go` is set: no rehearsal sees that.
    let broken = "net: broken
primitives:
  cancel: {type: Cancel}
  go: {type: Input, parameters: {initial: false}}
  near:
    type: JointGoal
    parameters: {device: lwr, scale: 0.1, start: continue}
    inputs: {goal: [deg(10), deg(-30), 0, deg(90), 0, deg(-60), 0], stop: cancel.requested}
  far: {type: Constant, parameters: {value: [deg(80), deg(-30), 0, deg(90), 0, deg(-60), 0]}}
  which: {type: Select, inputs: {condition: go.value, yes: far.out, no: near.position}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: which.out}}
  end: {type: Termination, inputs: {done: {there: cancel.requested}}}
discard: [near.done]
";
    let broken = cell.load(broken);
    let lamp = cell.load(
        "net: lamp
primitives:
  time: {type: Time}
  lamp: {type: DigitalOutput, parameters: {device: io, channel: lamp}, inputs: {in: true}}
  end: {type: Termination, inputs: {done: {over: \"= time.out > 0.2 s\"}}}
",
    );
    let third = cell.load(&moving("third", "0"));
    let body = json!({"rules": [
        {"when": format!("#{first}.moved.out"), "stop": first, "start": broken, "on_client_loss": "go on"},
        {"when": format!("#{broken}.reason == fault"), "start": lamp},
        {"when": format!("#{broken}.outcome == there"), "start": third, "on_client_loss": "go on"},
    ]});
    let reply = cell.rest("POST", "/rules", &body.to_string());
    assert_eq!(reply.status, 200, "{reply:?}\n{}", cell.logs());
    cell.done(first, "start");
    await_moved(&cell, broken);
    set_go(&cell, broken);
    cell.assert_ends(broken, "fault");
    cell.assert_ends(lamp, "finished");
    let ids: Vec<u64> = (0..3)
        .filter_map(|index| reply.body["rules"][index]["rule"].as_u64())
        .collect();
    for (rule, state) in ids.iter().zip(["fired", "fired", "expired"]) {
        await_rule(&cell, *rule, state);
    }
    assert_eq!(cell.state(third)["state"], "ready");
    cell.await_devices();
    cell.stop();
}
