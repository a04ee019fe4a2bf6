//! Vectors, rotations, poses, twists, wrenches and an arm's kinematics together, from the text to the values of a
//! cycle.

use crate::harness::{NetHarness, cell};
use rcc_language::compile;

/// A position away from singularities and limits, rad.
const HOLD: [f64; 7] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4];

fn text(primitives: &str, discard: &str) -> String {
    format!(
        "net: example\nprimitives:\n  end: {{type: Termination, inputs: {{done: false}}}}\n{primitives}\ndiscard: [{discard}]\n"
    )
}

/// Runs a net of these primitives for the golden cell.
fn run(primitives: &str, discard: &str) -> NetHarness {
    let cell = cell("tests/nets/cell.yaml");
    let net = compile(&text(primitives, discard), "net", &cell);
    NetHarness::new(net.unwrap_or_else(|faults| panic!("{faults}")), &cell, HOLD)
}

fn close(have: &[f64], want: &[f64], tolerance: f64) -> bool {
    have.len() == want.len()
        && have
            .iter()
            .zip(want)
            .all(|(a, b)| (a - b).abs() <= tolerance)
}

#[test]
fn computed_joint_velocities_move_the_flange_and_conserve_power() {
    let mut harness = run(
        "  state: {type: JointState, parameters: {device: lwr}}
  wanted: {type: MakeTwist, inputs: {linear: [0.02, 0.05, -0.01], angular: [0.1, 0, 0.2]}}
  rates: {type: InverseVelocityKinematics, parameters: {device: lwr, damping: 1e-6}, inputs: {joints: state.position, twist: wanted.out}}
  moving: {type: VelocityKinematics, parameters: {device: lwr}, inputs: {joints: state.position, velocity: rates.velocity}}
  load: {type: MakeWrench, inputs: {force: [10, -5, 2], torque: [0.3, 0.1, -0.2]}}
  torques: {type: JointTorqueFromWrench, parameters: {device: lwr}, inputs: {joints: state.position, wrench: load.out}}
  table: {type: Jacobian, parameters: {device: lwr}, inputs: {joints: state.position}}",
        "moving.twist, torques.torque, table.out",
    );
    harness.step();
    let twist = [0.02, 0.05, -0.01, 0.1, 0.0, 0.2];
    assert!(close(&harness.values("moving.twist"), &twist, 1e-9));
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let joints = sum(
        &harness.values("torques.torque"),
        &harness.values("rates.velocity"),
    );
    let flange = sum(&harness.values("load.out"), &twist);
    assert!((joints - flange).abs() < 1e-9, "{joints} W, {flange} W");
    // There is no null motion: the velocities are the smallest, a combination of the Jacobian's rows.
    let jacobian = harness.values("table.out");
    let rates = harness.values("rates.velocity");
    let row: Vec<f64> = (0..6)
        .map(|i| sum(&jacobian[7 * i..7 * i + 7], &rates))
        .collect();
    assert!(close(&row, &twist, 1e-9));
}

#[test]
fn pose_arm_angle_and_branch_determine_the_joints() {
    let mut harness = run(
        "  state: {type: JointState, parameters: {device: lwr}}
  is: {type: ForwardKinematics, parameters: {device: lwr}, inputs: {joints: state.position}}
  elbow: {type: ArmAngle, parameters: {device: lwr}, inputs: {joints: state.position}}
  back: {type: InverseKinematicsNear, parameters: {device: lwr}, inputs: {pose: is.pose, arm_angle: elbow.angle, hint: state.position}}",
        "back.joints",
    );
    harness.step();
    assert!(close(&harness.values("back.joints"), &HOLD, 1e-12));
}

#[test]
fn a_pose_integrated_from_a_twist_for_minutes_stays_normalised() {
    let start = "{xyz: [0.4, 0, 0.5], rpy: [0, 0, 0]}";
    let mut harness = run(
        &format!(
            "  speed: {{type: MakeTwist, inputs: {{linear: [0.01, 0, 0], angular: [0, 0, 0.5]}}}}
  now: {{type: OrElse, inputs: {{in: {{from: next.out, delayed: true, initial: {start}}}, other: {start}}}}}
  next: {{type: PoseAddTwist, inputs: {{pose: now.out, twist: speed.out}}}}
  found: {{type: TwistFromPoses, inputs: {{pose: next.out, previous: now.out}}}}
  parts: {{type: SplitPose, inputs: {{in: next.out}}}}
  angles: {{type: RotationToRpy, inputs: {{in: parts.rotation}}}}"
        ),
        "found.out, parts.position, angles.roll, angles.pitch, angles.yaw",
    );
    for _ in 0..1000 {
        harness.step();
    }
    assert!(close(
        &harness.values("parts.position"),
        &[0.41, 0.0, 0.5],
        1e-12
    ));
    assert!(close(&harness.values("angles.yaw"), &[0.5], 1e-12));
    assert!(close(
        &harness.values("found.out"),
        &[0.01, 0.0, 0.0, 0.0, 0.0, 0.5],
        1e-9
    ));
    for _ in 0..200_000 {
        harness.step();
    }
    let length: f64 = harness.values("parts.rotation").iter().map(|q| q * q).sum();
    assert!((length - 1.0).abs() < 1e-14, "{length}");
}

#[test]
fn a_null_anywhere_makes_the_whole_composite_null() {
    let mut harness = run(
        "  button: {type: AnalogInput, parameters: {device: io, channel: level}}
  point: {type: MakeVector, inputs: {x: button.out, y: 1, z: 2}}
  there: {type: TransformPoint, inputs: {pose: {xyz: [1, 2, 3], rpy: [0, 0, deg(90)]}, point: point.out}}",
        "there.out",
    );
    harness.inputs[1].measurement.analog[0] = 5.0;
    harness.step();
    assert!(close(&harness.values("there.out"), &[0.0, 7.0, 5.0], 1e-12));
    harness.inputs[1].measurement.analog[0] = f64::NAN;
    harness.step();
    let all = [harness.values("point.out"), harness.values("there.out")].concat();
    assert!(all.iter().all(|value| value.is_nan()), "{all:?}");
}

#[test]
fn the_moment_of_a_force_is_a_torque_and_nothing_else() {
    let net = |second: &str| {
        text(
            &format!(
                "  ft: {{type: ForceTorque, parameters: {{device: lwr}}}}
  both: {{type: SplitWrench, inputs: {{in: ft.wrench}}}}
  arm: {{type: MakeVector, inputs: {{x: 0.1 m, y: 0 m, z: 0 m}}}}
  moment: {{type: Cross, inputs: {{a: arm.out, b: both.force}}}}
  sum: {{type: MakeWrench, inputs: {{{second}}}}}"
            ),
            "ft.fx, ft.fy, ft.fz, ft.tx, ft.ty, ft.tz, both.torque, sum.out",
        )
    };
    let cell = cell("tests/nets/cell.yaml");
    let good = net("force: both.force, torque: moment.out");
    compile(&good, "net", &cell).unwrap_or_else(|faults| panic!("{faults}"));
    let bad = net("force: moment.out, torque: both.force");
    let Err(faults) = compile(&bad, "net", &cell) else {
        panic!("two faults");
    };
    let faults = faults.to_string();
    let said = [
        "`sum.force` expects N, but `moment.out` is in N·m",
        "`sum.torque` expects N·m, but `both.force` is in N",
    ];
    assert!(said.iter().all(|words| faults.contains(words)), "{faults}");
}

#[test]
fn commands_and_status_of_a_device_are_read_without_claiming_it() {
    let mut harness = run(
        "  lamp: {type: DigitalOutputState, parameters: {device: io, channel: lamp}}
  speed: {type: AnalogOutputState, parameters: {device: io, channel: speed}}
  mine: {type: DigitalOutput, parameters: {device: io, channel: lamp}, inputs: {in: true}}
  station: {type: DeviceStatus, parameters: {device: io}}
  lost: {type: IsNull, inputs: {in: station.age}}
  rates: {type: JointVelocity, parameters: {device: lwr}}",
        "lamp.out, speed.out, lost.out, rates.velocity",
    );
    harness.inputs[1].measurement.analog_out[0] = 0.25;
    harness.step();
    assert!(harness.value("lamp.out").is_nan(), "not told yet");
    assert_eq!(
        (harness.value("speed.out"), harness.value("lost.out")),
        (0.25, 0.0)
    );
    let m = &mut harness.inputs[1].measurement;
    (m.digital_out, m.digital_out_known) = (1, 1);
    harness.step();
    assert_eq!(harness.value("lamp.out"), 1.0);
    harness.inputs[1].present = false;
    harness.step();
    assert!(harness.value("lamp.out").is_nan() && harness.value("speed.out").is_nan());
    assert_eq!(harness.value("lost.out"), 1.0);
}

#[test]
fn the_net_of_the_docs_steers_the_flange() {
    let docs = std::fs::read_to_string(crate::harness::folder("docs/space.md")).expect("the docs");
    let net = docs
        .split("```")
        .find_map(|block| block.strip_prefix("yaml\n"));
    let cell = cell("tests/nets/cell.yaml");
    let compiled = compile(net.expect("a net"), "docs", &cell);
    let net = compiled.unwrap_or_else(|faults| panic!("{faults}"));
    let mut harness = NetHarness::new(net, &cell, HOLD);
    let arm = cell.models()[0].arm.expect("an arm");
    let flange = |harness: &NetHarness| {
        let joints: [f64; 7] = harness.values("next.out").try_into().expect("seven joints");
        arm.forward(&crate::harness::eight(&joints))
    };
    harness.step();
    assert_eq!(harness.values("next.out"), HOLD);
    let start = flange(&harness);
    harness.inputs[1].measurement.digital = 1;
    for _ in 0..2000 {
        harness.step();
    }
    // Half a second from 0 to 50 mm/s, then constant: 87.5 mm, and nothing else changes.
    let (there, turned) = (flange(&harness), start.angle_to(&flange(&harness)));
    let way = [0, 1, 2].map(|axis: usize| there.position[axis] - start.position[axis]);
    assert!(close(&way, &[0.0, 0.0875, 0.0], 2e-4), "{way:?}");
    assert!(turned < 2e-4, "{turned}");
    harness.cancel = true;
    for _ in 0..1000 {
        harness.step();
    }
    assert!(harness.terminated && harness.value("speed.out") == 0.0);
}
