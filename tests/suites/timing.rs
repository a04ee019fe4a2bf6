//! Execution times and admission in real cells: nets that are too large for their period are refused, or end with a
//! fault if the configuration admits them. Each test has a cell of its own; no time is asserted.

use rcc_tests::{TestCell, await_some, nets, turns};

/// Number of inverse kinematics: together some milliseconds per cycle on any current machine.
const MANY: usize = 12_000;

/// Returns a net that commands nothing and has a long execution time, until CANCEL.
fn large(name: &str) -> String {
    let rows = (0..MANY).map(|number| {
        format!(
            "  ik{number}: {{type: InverseKinematics, parameters: {{device: lwr}}, inputs: {{pose: fk.pose}}}}\n"
        )
    });
    let unread = (0..MANY).map(|number| format!(", ik{number}.joints"));
    format!(
        "net: {name}
primitives:
  cancel: {{type: Cancel}}
  state: {{type: JointState, parameters: {{device: lwr}}}}
  fk: {{type: ForwardKinematics, parameters: {{device: lwr}}, inputs: {{joints: state.position}}}}
{}  end: {{type: Termination, inputs: {{done: cancel.requested}}}}
discard: [state.hold, state.torque, state.external_torque{}]
",
        rows.collect::<String>(),
        unread.collect::<String>()
    )
}

#[test]
fn a_net_that_is_too_large_for_its_period_is_refused_with_the_numbers() {
    let cell = TestCell::demo();
    let (large, small) = (cell.load(&large("large")), cell.load(&nets::clock("small")));
    let (large_ns, small_ns) = (
        cell.state(large)["expected_ns"].as_u64().expect("a number"),
        cell.state(small)["expected_ns"].as_u64().expect("a number"),
    );
    assert!(
        small_ns > 0 && large_ns > 100 * small_ns,
        "{small_ns} {large_ns}"
    );
    let refused = cell.operate(large, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3022"),
        "{refused:?}"
    );
    assert!(refused.error_text().contains("500.0 µs"), "{refused:?}");
    assert_eq!(cell.state(large)["state"], "ready", "nothing changed");
    cell.done(small, "start");
    let (explained, _) = cell.cli_exits(0, &["explain", "large"]);
    assert!(
        explained.contains("InverseKinematics") && explained.contains("in use"),
        "{explained}"
    );
    let (listed, _) = cell.cli_exits(0, &["ls"]);
    assert!(listed.contains("EXPECTED"), "{listed}");
    cell.done(small, "cancel");
    cell.assert_ends(small, "canceled");
    cell.stop();
}

#[test]
fn a_net_that_is_admitted_although_it_is_too_large_ends_with_an_overrun() {
    let _alone = turns::alone();
    let cell = TestCell::changed(|text| {
        text.replacen(
            "executor: {priority: 80}",
            "executor: {priority: 80, late_in_a_row_max: 20, budget: 10000 %}",
            1,
        )
    });
    let (large, small) = (cell.load(&large("large")), cell.load(&nets::clock("small")));
    cell.done(small, "start");
    cell.done(large, "start");
    let ended = cell.await_end(large);
    assert_eq!(ended["reason"], "fault", "{ended}");
    assert_eq!(ended["fault"]["fault"], "overrun", "{ended}");
    assert_eq!(
        cell.state(small)["state"],
        "running",
        "the other net keeps running"
    );
    let status = cell.rest("GET", "/status", "").body;
    let executor = &status["executor"];
    // Which late cycles are still latched depends on the latency of the machine; the log has the cause.
    assert!(
        executor["last_late"]["cycle"].as_u64() > Some(0),
        "{executor}"
    );
    let (words, _) = cell.cli_exits(0, &["status"]);
    assert!(
        words.contains("first late: cycle") && words.contains("--acknowledge"),
        "{words}"
    );
    let (screen, _) = cell.cli_exits(0, &["top", "--once"]);
    assert!(
        screen.contains("InverseKinematics") && screen.contains("small#"),
        "{screen}"
    );
    let (_, _) = cell.cli_exits(0, &["status", "--acknowledge"]);
    await_some("the acknowledgement to be seen", || {
        let status = cell.rest("GET", "/status", "").body;
        let acknowledged = status["executor"]["late_acknowledged"].as_u64();
        acknowledged.filter(|late| *late > 0)
    });
    let log = await_some("the events", || {
        let (events, _) = cell.cli_exits(0, &["events"]);
        let complete =
            events.contains("computed long, most of it large") && events.contains("overrun");
        complete.then_some(events)
    });
    assert!(log.contains("acknowledged"), "{log}");
    cell.done(small, "cancel");
    cell.assert_ends(small, "canceled");
    cell.stop();
}
