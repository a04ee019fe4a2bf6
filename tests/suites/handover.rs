//! Hand-over through all processes: it happens in consecutive cycles with one unbroken stream of set-points, or it
//! changes nothing and the reason is reported. Each test has a cell of its own.

use rcc_core::guard::ViolationKind;
use rcc_core::message::{CommandState, DeviceState};
use rcc_core::plan::KernelRun;
use rcc_core::primitives;
use rcc_protocol::control::{Answer, Call, PlanData, Refusal};
use rcc_tests::handover::{Arm, hand_over};
use rcc_tests::{TestCell, await_some, nets, turns};

use crate::plans::Control;

/// Velocity of the moving arm, rad/s: a velocity step of this size keeps the jerk limit of the joint, and the position
/// step that the acceleration limit allows in one cycle is as long as 140 cycles at this velocity.
const VELOCITY: f64 = 1.5e-4;
const PERIOD_S: f64 = 1e-3;

#[test]
fn an_arm_goes_from_net_to_net_in_consecutive_cycles_while_a_large_net_is_loading() {
    let _alone = turns::alone();
    let cell = TestCell::demo();
    let report = hand_over(&cell, 30, 5000, |_| {});
    assert_eq!(
        (report.consecutive, report.unbroken),
        (30, 30),
        "{report:?}"
    );
    // Each hand-over is requested right after a LOAD that takes much longer; if the machine stalls, a few may come
    // later.
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
        errors.contains("RCC3004") && errors.contains("no command was stopped"),
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

/// Returns a net that holds the arm at its set-point until the net is stopped.
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

/// Returns a plan that moves J1 from `from` (rad) on with [`VELOCITY`] without end, and holds the other joints.
fn drift(from: f64, configuration: u64) -> PlanData {
    let mut plan = PlanData {
        catalogue: primitives::fingerprint(),
        configuration,
        reals: vec![from, VELOCITY, f64::NAN, f64::NAN],
        bools: vec![0],
        ..PlanData::default()
    };
    plan.reals.extend(nets::START);
    let runs: [(&str, &[u32]); 5] = [
        ("Time", &[2]),
        ("Multiply", &[2, 1, 3]),
        ("Add", &[0, 3, 4]),
        ("JointPositionCommand", &[4, 0, 7]),
        ("Termination", &[0]),
    ];
    for (name, operands) in runs {
        let (entry, row) = primitives::find(name).expect("a primitive");
        let fits = |kernel| row.spec.operands(kernel).count() == operands.len();
        let kernel = row.kernels.iter().position(fits).expect("a kernel");
        plan.runs.push(KernelRun {
            kernel: primitives::kernel_number(entry, kernel),
            first: plan.operands.len() as u32,
            operands: operands.len() as u32,
        });
        plan.operands.extend(operands);
    }
    plan
}

fn install(control: &Control, from: f64) -> u64 {
    let id = control.reserve();
    let plan = drift(from, control.config.fingerprint());
    let answer = control.call(&Call::Install { id, plan });
    assert!(cycle_of(&answer).is_some(), "{answer:?}");
    id
}

/// Returns the cycle of an answer that reports success.
fn cycle_of(answer: &Answer) -> Option<u64> {
    match answer {
        Answer::Done { cycle } | Answer::Rehearsed { cycle, .. } => Some(*cycle),
        _ => None,
    }
}

/// Requests the hand-over until the arm reaches the start of `new`; returns its cycle, or `None` if the arm has passed
/// the start.
fn take_over(control: &Control, old: u64, new: u64, refusals: &mut u32) -> Option<u64> {
    loop {
        let (stop, start) = (vec![old], vec![new]);
        match control.call(&Call::Switch {
            stop,
            start,
            lease: 0,
        }) {
            Answer::Done { cycle } => return Some(cycle),
            Answer::RefusedFor {
                id,
                refusal:
                    Refusal::Continuation {
                        value, violation, ..
                    },
            } => {
                assert_eq!(id, new);
                assert!(ViolationKind::from_number(violation).is_some());
                *refusals += 1;
                if value < 0.0 {
                    return None;
                }
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_moving_arm_is_handed_over_only_where_the_next_net_continues_its_motion() {
    let cell = TestCell::demo();
    let control = Control::of(&cell);
    let (watch, arm) = (cell.watch(), Arm::of(&cell));
    let old = install(&control, nets::START[0]);
    let first = await_some("the arm to be ready", || {
        cycle_of(&control.call(&Call::Start { id: old, lease: 0 }))
    });
    let mut refusals = 0;
    let (new, from, cycle) = await_some("a hand-over in motion", || {
        let ahead = (watch.status().cycle - first + 300) as f64 * PERIOD_S;
        let from = nets::START[0] + ahead * VELOCITY;
        let new = install(&control, from);
        let taken = take_over(&control, old, new, &mut refusals);
        if taken.is_none() {
            // The machine stalled while the arm passed the start.
            control.call(&Call::Unload { id: new });
        }
        taken.map(|cycle| (new, from, cycle))
    });
    eprintln!("{refusals} refusals before the arm reached the start");
    assert!(
        refusals > 0,
        "the first requests came before the arm reached the start"
    );
    let rows = watch.tables().commands;
    let row = |id: u64| *rows.iter().find(|row| row.id == id).expect("a row");
    assert_eq!(
        (row(old).ended_cycle, row(new).started_cycle),
        (cycle - 1, cycle)
    );
    await_some("the new net to continue", || {
        (watch.status().cycle > cycle + 300).then_some(())
    });
    // The set-points follow the line, and so does the arm.
    let image = arm.image();
    let wanted = |sequence: u64| from + (sequence - cycle) as f64 * PERIOD_S * VELOCITY;
    for point in (0..16).filter_map(|back| image.at(image.head.sequence - back)) {
        let sequence = point.logical_ns / image.head.period_ns;
        assert!((point.position[0] - wanted(sequence)).abs() < 1e-12 && point.has_position == 1);
    }
    let measured = arm.measurement();
    assert_eq!(measured.state, DeviceState::Commanded as u32);
    assert!((measured.position[0] - wanted(image.head.sequence)).abs() < 1e-3);
    assert_eq!(cell.state(new)["state"], CommandState::Running.name());
    control.call(&Call::Abort { id: new });
    cell.assert_ends(new, "aborted");
    drop((watch, arm, control));
    cell.stop();
}
