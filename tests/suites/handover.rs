//! Hand-over through every process: consecutive cycles, one stream of set-points, or nothing changed and the reason told.
//! Each test has a cell of its own.

use rcc_tests::handover::hand_over;
use rcc_tests::{TestCell, nets};

#[test]
fn an_arm_goes_from_net_to_net_in_consecutive_cycles_while_a_large_net_is_loading() {
    let cell = TestCell::demo();
    let report = hand_over(&cell, 30, 5000, |_| {});
    assert_eq!(
        (report.consecutive, report.unbroken),
        (30, 30),
        "{report:?}"
    );
    // Asked right after LOAD, whose text takes much longer; a machine that stalls may miss a few.
    assert!(report.while_loading >= 20, "{report:?}");
    cell.stop();
}

#[test]
fn the_command_line_hands_over_and_a_refusal_names_the_net_and_changes_nothing() {
    let cell = TestCell::demo();
    let first = cell.run(&nets::lamp("first"));
    let second = cell.load(&nets::lamp("second"));
    let third = cell.load(&nets::lamp("third"));
    let (_, errors) = cell.cli_exits(
        5,
        &["start", "second", "third", "--after-stopping", "first"],
    );
    assert!(
        errors.contains("RCC3004") && errors.contains("nothing is stopped"),
        "{errors}"
    );
    assert_eq!(cell.state(first)["state"], "running");
    let (out, _) = cell.cli_exits(0, &["start", "second", "--after-stopping", "first"]);
    assert!(out.contains(&format!("first#{first}  stopped")), "{out}");
    assert!(out.contains(&format!("second#{second}  running")), "{out}");
    cell.assert_ends(first, "aborted");
    let (_, errors) = cell.cli_exits(5, &["start", "third", "--after-stopping", "first"]);
    assert!(
        errors.contains("RCC3003") && errors.contains("first"),
        "{errors}"
    );
    let reply = cell.rest(
        "POST",
        &format!("/commands/{third}/start"),
        &format!(r#"{{"after_stopping": [{second}]}}"#),
    );
    assert_eq!(reply.status, 200, "{reply:?}");
    cell.assert_ends(second, "aborted");
    cell.done(third, "cancel");
    cell.assert_ends(third, "canceled");
    cell.stop();
}

#[test]
fn a_net_that_holds_the_arm_hands_it_to_a_motion_planned_meanwhile() {
    let cell = TestCell::demo();
    let there = cell.run(&nets::line("there", 0.05, 0.2));
    cell.assert_ends(there, "finished");
    cell.await_device("lwr", "ready");
    let stay = cell.run(&hold("stay"));
    let back = cell.load(&nets::line("back", 0.0, 0.2));
    let body = format!(r#"{{"stop": [{stay}], "start": [{back}]}}"#);
    let switched = cell.rest("POST", "/switch", &body);
    assert_eq!(switched.status, 200, "{switched:?}");
    cell.assert_ends(stay, "aborted");
    cell.assert_ends(back, "finished");
    cell.stop();
}

/// Holds the arm where it is held, until it is stopped.
fn hold(name: &str) -> String {
    format!(
        "net: {name}
primitives:
  state: {{type: JointState, parameters: {{device: lwr}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: state.hold}}}}
  end: {{type: Termination, inputs: {{done: false}}}}
discard: [state.position]
"
    )
}
