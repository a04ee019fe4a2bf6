//! Impedance control through all processes: a net presses with a spring of its own on a simulated table.
//! Each test has a cell of its own.

use rcc_protocol::Role;
use rcc_tests::simulator::{Simulator, joints_of};
use rcc_tests::{TestCell, await_some, repository};

/// Stiffness of the table in `configs/cells/impedance.yaml`, N/m.
const TABLE: f64 = 30_000.0;
/// Stiffness along z in `configs/impedance/press.yaml`, N/m.
const SPRING: f64 = 500.0;
/// Depth of the set-point below the table in that net, m.
const DEPTH: f64 = 0.02;
/// Additional force in that net, N.
const ADDITIONAL: f64 = 5.0;
/// Stiffness of the last joint in [`JOINTS`], N·m/rad.
const JOINT_SPRING: f64 = 200.0;
/// Additional torque of the last joint in [`JOINTS`], N·m.
const TORQUE: f64 = 2.0;
const JOINTS: &str = "
net: joint-springs
primitives:
  cancel: {type: Cancel}
  robot:
    type: JointImpedanceCommand
    parameters: {device: lwr}
    inputs:
      position: [deg(0), deg(-30), deg(0), deg(90), deg(0), deg(-60), deg(0)]
      stiffness: [1000, 1000, 1000, 1000, 1000, 1000, 200]
      torque: [0, 0, 0, 0, 0, 0, 2]
  end: {type: Termination, inputs: {done: cancel.requested}}
";
/// Tolerance for the rounding to binary32 in datagrams and for the last movements of the arm, N.
const CLOSE: f64 = 0.02;

fn cell() -> TestCell {
    TestCell::start(&repository().join("configs/cells/impedance.yaml"), |text| {
        text
    })
}

fn press() -> String {
    let path = repository().join("configs/impedance/press.yaml");
    std::fs::read_to_string(path).expect("the example")
}

/// Returns the force of the table, N, when the spring pulls the tool into it and `added` (N) presses additionally: at
/// rest both springs carry the same force.
fn force(added: f64) -> f64 {
    (SPRING * DEPTH + added) * TABLE / (TABLE + SPRING)
}

/// Waits until the table pushes with this force (N) and the arm is at rest, and both are true 200 ticks later, too.
fn await_force(arm: &mut Simulator, wanted: f64) {
    let mut close = || {
        let state = arm.state();
        let push = state["wrench"][2].as_f64()?;
        let tick = state["tick"].as_u64()?;
        ((push - wanted).abs() < CLOSE && state["at_rest"] == true).then_some(tick)
    };
    let begun = await_some(&format!("the table to push with {wanted} N"), &mut close);
    await_some("this to last", || (close()? > begun + 200).then_some(()));
}

/// Starts the cell and the pressing net; returns them once the force is reached.
fn pressing() -> (TestCell, Simulator, u64) {
    let cell = cell();
    let mut arm = cell.simulator("lwr-sim");
    cell.await_devices();
    let id = cell.run(&press());
    await_force(&mut arm, force(ADDITIONAL));
    (cell, arm, id)
}

fn assert_no_fault(arm: &mut Simulator) {
    let state = arm.state();
    assert_eq!(state["faults"], serde_json::json!([]), "{state}");
    assert_eq!(state["strategy"], "cartesian-impedance", "{state}");
}

#[test]
fn the_force_is_the_stiffness_times_the_depth_and_the_end_removes_the_additional_force() {
    let (cell, mut arm, id) = pressing();
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    await_force(&mut arm, force(0.0));
    assert_no_fault(&mut arm);
    cell.await_device("lwr", "ready");
    cell.stop();
}

#[test]
fn when_the_executor_dies_the_additional_force_is_removed() {
    let (cell, mut arm, _) = pressing();
    let dead = cell.kill(Role::Executor, "exec");
    await_force(&mut arm, force(0.0));
    assert_no_fault(&mut arm);
    cell.await_successor(Role::Executor, "exec", dead);
    cell.stop();
}

#[test]
fn null_in_the_wrench_releases_the_arm() {
    let cell = cell();
    let mut arm = cell.simulator("lwr-sim");
    cell.await_devices();
    // A null wrench is a null set-point.
    let text = press()
        .replace(
            "      wrench: [0, 0, -5, 0, 0, 0]  # N, N·m\n",
            "      wrench: push.out\n",
        )
        .replace(
            "  over: ",
            "  lost: {type: Input, parameters: {initial: false}}
  some: {type: MakeWrench, inputs: {force: [0, 0, -5], torque: [0, 0, 0]}}
  push: {type: NullIf, inputs: {in: some.out, condition: lost.value}}
  over: ",
        );
    let id = cell.run(&text);
    await_force(&mut arm, force(ADDITIONAL));
    let set = cell.rest(
        "PUT",
        &format!("/commands/{id}/inputs"),
        r#"{"lost": true}"#,
    );
    assert_eq!(set.status, 200, "{set:?}");
    await_force(&mut arm, force(0.0));
    assert_no_fault(&mut arm);
    // The net itself keeps running: only its set-point is null.
    assert_eq!(cell.state(id)["state"], "running");
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    cell.stop();
}

#[test]
fn a_joint_turns_by_torque_over_stiffness_and_comes_back_at_the_end() {
    let path = repository().join("configs/cells/impedance.yaml");
    let cell = TestCell::start(&path, |text| {
        text.replace("cartesian-impedance ", "joint-impedance ")
    });
    let mut arm = cell.simulator("lwr-sim");
    cell.await_devices();
    let mut await_angle = |wanted: f64| {
        let mut close = || {
            let state = arm.state();
            let (q, tick) = (joints_of(&state["q"]), state["tick"].as_u64()?);
            let others = q[0].abs() < 1e-4 && (q[3] - 90_f64.to_radians()).abs() < 1e-4;
            ((q[6] - wanted).abs() < 1e-4 && others && state["at_rest"] == true).then_some(tick)
        };
        let begun = await_some(&format!("J7 to be at {wanted} rad"), &mut close);
        await_some("this to last", || (close()? > begun + 200).then_some(()));
        let state = arm.state();
        assert_eq!(state["faults"], serde_json::json!([]), "{state}");
        assert_eq!(state["strategy"], "joint-impedance", "{state}");
    };
    await_angle(0.0);
    let id = cell.run(JOINTS);
    await_angle(TORQUE / JOINT_SPRING);
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    await_angle(0.0);
    cell.await_device("lwr", "ready");
    let (_, row) = cell.load_any(&JOINTS.replace("0, 2]", "0, 1000]"));
    let words = row.to_string();
    assert!(
        row["state"] == "rejected"
            && words.contains("lwr joint 7: additional load 1000 N·m exceeds 15 N·m"),
        "{words}"
    );
    cell.stop();
}

#[test]
fn a_net_for_another_strategy_is_refused_with_a_remedy_and_nothing_moves() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    cell.await_devices();
    let id = cell.load(&press());
    await_some("the net to be ready", || {
        (cell.state(id)["state"] == "ready").then_some(())
    });
    let reply = cell.operate(id, "start");
    let words = reply.body.to_string();
    assert_eq!(reply.status, 409, "{words}");
    for part in [
        "runs position control",
        "set-points are for Cartesian impedance control",
        "$STIFFNESS.STRATEGY = 20",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    assert_eq!(cell.state(id)["state"], "ready");
    arm.assert_still(200);
    cell.stop();
}

#[test]
fn a_stiffness_beyond_the_limit_of_the_robot_is_refused_with_its_axis() {
    let cell = cell();
    cell.await_devices();
    let (_, row) = cell.load_any(&press().replace("[2000, 2000, 500]", "[2000, 2000, 5001]"));
    let words = row.to_string();
    assert!(
        row["state"] == "rejected"
            && words.contains("lwr axis z: stiffness 5001 N/m is beyond the limit 5000 N/m"),
        "{words}"
    );
    cell.stop();
}
