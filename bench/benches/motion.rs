//! What motion costs in a cycle: kinematics, the path clock, each kind of motion, and whole nets that move one arm and two.
//! `cargo bench -p rcc-bench --bench motion`. Only ratios within one run carry over to other machines.
#![allow(missing_docs)] // criterion makes an undocumented function.

use std::hint::black_box;

use bytemuck::Zeroable;
use criterion::{Criterion, criterion_group, criterion_main};
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, SrsArm};
use rcc_core::message::{Joints, Measurement};
use rcc_core::path::{ArcOrientation, Drive, Leg, MotionBuilder, Motions, PathRequest, Segment};
use rcc_core::pose::Pose;
use rcc_engine::net::{Evaluation, Net};
use rcc_language::compile_for;
use rcc_language::devices::{Device, DeviceTable};
use rcc_motion::{Builder, MotionSet, PathBounds, PathClock, PathPiece};

const HOLD: Joints = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

/// An LWR 4+.
fn model() -> DeviceModel {
    DeviceModel {
        joints: 7,
        arm: Some(Arm::Srs(SrsArm {
            shoulder_height: 0.3105,
            upper_arm: 0.4,
            forearm: 0.39,
            wrist_to_flange: 0.078,
            signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
        })),
        limits: JointLimits {
            lower: [-2.9; 8],
            upper: [2.9; 8],
            velocity_max: [2.0; 8],
            acceleration_max: [20.0; 8],
            jerk_max: [200.0; 8],
            joints: 7,
        },
        first_tolerance_rad: 1e-3,
        workspace: None,
        base: Pose::IDENTITY,
        channels: [0; 4],
    }
}

fn arm() -> Arm {
    model().arm.expect("it has one")
}

/// A pose beside the start.
fn beside(x: f64, y: f64, z: f64) -> Pose {
    let start = arm().forward(&HOLD);
    start.compose(&Pose::from_xyz_rpy([x, y, z], [0.1, 0.0, 0.0]))
}

fn kinematics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kinematics of an LWR 4+");
    let (arm, hold) = (arm(), HOLD);
    let pose = arm.forward(&hold);
    let configuration = arm.configuration(&hold);
    let (branch, angle) = (configuration.branch, configuration.arm_angle);
    group.bench_function("forward", |b| b.iter(|| arm.forward(black_box(&hold))));
    group.bench_function("forward and Jacobian", |b| {
        b.iter(|| arm.jacobian(black_box(&hold)))
    });
    group.bench_function("inverse, one branch", |b| {
        b.iter(|| arm.inverse(black_box(&pose), angle, branch, &hold))
    });
    group.bench_function("inverse, all branches", |b| {
        b.iter(|| arm.all_branches(black_box(&pose), angle, &hold))
    });
    group.finish();
}

fn clock(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("path clock");
    for (name, count) in [("one piece", 1), ("40 pieces", 40)] {
        let pieces: Vec<PathPiece> = (1..=count)
            .map(|k| PathPiece {
                end_s: 1e4 * f64::from(k) / f64::from(count),
                velocity: if k % 2 == 0 { 0.5 } else { 0.2 },
            })
            .collect();
        let bounds = PathBounds::new(&pieces, 2.0, 20.0, 1e-3).expect("these are limits");
        let mut clock = PathClock::new();
        group.bench_function(format!("{name}, as before"), |b| {
            b.iter(|| clock.step(black_box(&bounds), Drive::RUN))
        });
        let mut slow = false;
        group.bench_function(format!("{name}, a new speed each cycle"), |b| {
            b.iter(|| {
                slow = !slow;
                let speed = if slow { 0.6 } else { 1.0 };
                let drive = Drive {
                    speed,
                    ..Drive::RUN
                };
                clock.step(black_box(&bounds), drive)
            })
        });
    }
    group.finish();
}

fn motion(legs: &[Leg<'_>], joints: bool) -> MotionSet {
    let (models, holds) = ([model()], [Some(HOLD)]);
    let mut builder = Builder::new(&models, &holds, 1e-3, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs,
        joints,
    };
    builder.path(0, &request).expect("the arm can do this");
    builder.finish().expect("it was asked for")
}

fn motions(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("a cycle of a motion");
    let to = beside(0.1, 0.1, 0.0);
    let line = Segment::Line { to };
    let circle = Segment::Circle {
        via: beside(0.05, 0.05, 0.02).position,
        to,
        orientation: ArcOrientation::Even,
        angle: None,
    };
    let through = [beside(0.05, 0.0, 0.0), beside(0.05, 0.08, 0.02), to];
    let spline = Segment::Spline { through: &through };
    let joints = Segment::Joints {
        to: [0.6, 0.2, 0.1, -1.2, 0.4, 0.7, 0.0, f64::NAN],
    };
    // So slow that a run is much longer than its ends.
    let leg = |segment, blend| Leg {
        scale: 0.02,
        blend,
        ..Leg::new(segment)
    };
    let back = Segment::Line {
        to: beside(0.0, 0.1, 0.0),
    };
    for (name, legs, joints) in [
        ("line, poses", vec![leg(line, 0.0)], false),
        ("line", vec![leg(line, 0.0)], true),
        ("arc", vec![leg(circle, 0.0)], true),
        ("spline", vec![leg(spline, 0.0)], true),
        ("point to point", vec![leg(joints, 0.0)], true),
        (
            "three rounded lines",
            vec![leg(line, 0.03), leg(back, 0.03), leg(line, 0.0)],
            true,
        ),
    ] {
        let legs: Vec<Leg<'_>> = if joints {
            legs
        } else {
            let limits = rcc_core::path::Limits::of([0.01, 0.1, 1.0]);
            let slow = |leg| Leg {
                line: limits,
                turn: limits,
                ..leg
            };
            legs.into_iter().map(slow).collect()
        };
        let mut set = motion(&legs, joints);
        group.bench_function(name, |b| {
            b.iter(|| {
                let state = set.step(0, Drive::RUN);
                if state.is_none_or(|state| state.path.done) {
                    set.reset();
                }
                state
            })
        });
    }
    group.finish();
}

/// A net that moves each of these arms along a line of its own, as `configs/nets/line.yaml` does.
fn lines(arms: &[&str]) -> String {
    let mut text = String::from("net: lines\nprimitives:\n");
    for (index, arm) in arms.iter().enumerate() {
        let [x, y, z] = beside(0.1, 0.1, 0.0).position;
        text += &format!(
            "  move{index}: {{type: LinearMotion, parameters: {{device: {arm}, \
             to: {{xyz: [{x}, {y}, {z}], rpy: [0, deg(170), 0]}}, velocity: 0.005 m/s, \
             acceleration: 0.5 m/s^2, jerk: 5 m/s^3}}}}\n  \
             ik{index}: {{type: InverseKinematics, parameters: {{device: {arm}}}, \
             inputs: {{pose: move{index}.pose}}}}\n  \
             robot{index}: {{type: JointPositionCommand, parameters: {{device: {arm}}}, \
             inputs: {{position: ik{index}.joints}}}}\n"
        );
    }
    text += "  end: {type: Termination, inputs: {done: move0.done}}\n";
    text
}

fn nets(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("a cycle of a net");
    let device = |name: &str| Device {
        name: name.to_string(),
        model: model(),
        channels: Default::default(),
    };
    let table = DeviceTable {
        fingerprint: 0,
        period_ns: 1_000_000,
        devices: vec![device("left"), device("right")],
    };
    let models = [model(), model()];
    let mut measurement = Measurement::zeroed();
    (measurement.joints, measurement.position, measurement.hold) = (7, HOLD, HOLD);
    let input = DeviceInput {
        present: true,
        measurement,
    };
    for (name, arms) in [
        ("line, one arm", &["left"][..]),
        ("lines, two arms", &["left", "right"]),
    ] {
        let net = compile_for(&lines(arms), "lines.yaml", &table);
        let plan = net.unwrap_or_else(|faults| panic!("{faults}")).plan;
        let holds = [Some(HOLD), Some(HOLD)];
        let mut net = Net::build(plan, &models, 0, &holds, 1e-3).expect("a good plan");
        group.bench_function(name, |b| {
            b.iter(|| {
                let evaluation = net.evaluate(&models, &[input, input], 1e-3);
                if evaluation != Evaluation::Running {
                    net.reset();
                }
                evaluation
            })
        });
    }
    group.finish();
}

criterion_group!(benches, kinematics, clock, motions, nets);
criterion_main!(benches);
