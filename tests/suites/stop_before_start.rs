//! START of a net that is built again, because its arm rests elsewhere than at LOAD: a stop that a client requests
//! meanwhile, and a client that does not wait. Each test has a cell of its own.

use std::fmt::Write as _;

use rcc_tests::{TestCell, await_some};
use serde_json::{Value, json};

/// Moves the arm elsewhere.
const AWAY: &str = "net: away
primitives:
  move:
    type: JointGoal
    parameters: {device: lwr, scale: 0.3}
    inputs: {goal: [deg(20), deg(-30), 0, deg(90), 0, deg(-60), 0]}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: move.position}}
  end: {type: Termination, inputs: {done: move.done}}
";

const OTHER: &str = "net: other
primitives:
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
";

/// A path from wherever the arm rests, whose planning takes long.
fn slow_net() -> String {
    let mut legs = String::new();
    for leg in 0..12 {
        let x = [60, -60, -60, 60][leg % 4];
        let y = [40, 40, -40, -40][leg % 4];
        writeln!(
            legs,
            "        - {{lin: {{xyz: [{x} mm, {y} mm, 0], rpy: [0, 0, 0]}}, relative: base, blend: 15 mm}}"
        )
        .expect("into a String");
    }
    format!(
        "net: slow
primitives:
  cancel: {{type: Cancel}}
  move:
    type: MotionSequence
    parameters:
      device: lwr
      time_optimal: true
      stops: give
      path:
{legs}        - {{lin: {{xyz: [0, 0, 20 mm], rpy: [0, 0, 0]}}, relative: base}}
    inputs: {{stop: cancel.requested}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: move.joints}}}}
  end: {{type: Termination, inputs: {{done: move.done}}}}
"
    )
}

/// A cell in which [`slow_net`] is loaded, and its arm rests elsewhere.
fn cell() -> (TestCell, u64) {
    let cell = TestCell::demo();
    let slow = cell.load(&slow_net());
    let away = cell.run(AWAY);
    cell.assert_ends(away, "finished");
    (cell, slow)
}

/// Asserts that the command never ran. UNLOAD waits until its net is built, and is refused for one that runs, as the motion
/// would for seconds.
fn assert_never_ran(cell: &TestCell, id: u64) {
    let unloaded = await_some("the net to be built", || {
        let reply = cell.rest("DELETE", &format!("/commands/{id}"), "");
        (reply.code() != "RCC4002").then_some(reply)
    });
    assert_eq!(unloaded.status, 200, "{unloaded:?}");
}

/// Requests START and, until the stop is accepted, `stop`; returns the code with which START was refused.
fn stopped(cell: &TestCell, id: u64, stop: &str) -> Value {
    std::thread::scope(|scope| {
        let start = scope.spawn(|| cell.operate(id, "start"));
        await_some("the stop to be accepted", || {
            (cell.operate(id, stop).status == 200).then_some(())
        });
        let reply = start.join().expect("START is answered");
        assert_ne!(reply.status, 200, "{stop} came after START: {reply:?}");
        reply.body
    })
}

#[test]
fn a_stop_withdraws_the_start_and_disarms_what_would_start_the_net_after_it() {
    for stop in ["cancel", "abort"] {
        let (cell, slow) = cell();
        let other = cell.run(OTHER);
        let lease = cell.rest("POST", "/leases", r#"{"expires_ms": 60000}"#);
        let rule = json!({"when": "other.state == terminated", "start": "slow"});
        let body = json!({"rules": [rule], "lease": lease.body["lease"]});
        let installed = cell.rest("POST", "/rules", &body.to_string());
        assert_eq!(installed.status, 200, "{installed:?}");
        let told = stopped(&cell, slow, stop);
        assert!(
            told["message"]
                .as_str()
                .is_some_and(|words| words.contains("withdrawn")),
            "{told}"
        );
        let rule = cell.rest("GET", "/rules/1", "").body;
        assert_eq!(rule["state"], "disarmed", "{stop}: {rule}");
        cell.done(other, "abort");
        assert_never_ran(&cell, slow);
        cell.stop();
    }
}

#[test]
fn a_start_that_its_client_gave_up_does_not_happen() {
    let (cell, slow) = cell();
    let (_, told) = cell.cli_exits(6, &["--timeout", "10ms", "start", "slow"]);
    assert!(told.contains("RCC40"), "{told}");
    assert_never_ran(&cell, slow);
    cell.stop();
}
