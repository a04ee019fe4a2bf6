//! What a cycle of motion costs, ns, without the net around it: `cargo run --release -p rcc-motion --example costs`.
//! `cargo bench -p rcc-bench --bench motion` measures whole nets too. One thread.

use std::hint::black_box;
use std::time::Instant;

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, SrsArm};
use rcc_core::message::Joints;
use rcc_core::path::{
    ArcOrientation, Drive, Leg, Limits, MotionBuilder, MotionState, Motions, PathRequest, Segment,
};
use rcc_core::pose::Pose;
use rcc_motion::{Builder, MotionSet, PathBounds, PathClock, PathPiece};

const BATCH: usize = 1000;
const HOLD: Joints = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

/// Prints the best and the median of many batches, ns a call.
fn measure(name: &str, mut call: impl FnMut(usize)) {
    let mut all: Vec<f64> = (0..1000)
        .map(|_| {
            let begin = Instant::now();
            (0..BATCH).for_each(&mut call);
            begin.elapsed().as_nanos() as f64 / BATCH as f64
        })
        .collect();
    all.sort_by(f64::total_cmp);
    println!("{name:44} {:6.0}  {:6.0}", all[0], all[all.len() / 2]);
}

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

fn clocks() {
    let stairs = |count: u32| {
        let piece = |k: u32| PathPiece {
            end_s: 1e4 * f64::from(k) / f64::from(count),
            velocity: if k.is_multiple_of(2) { 0.5 } else { 0.2 },
        };
        let pieces: Vec<PathPiece> = (1..=count).map(piece).collect();
        PathBounds::new(&pieces, 2.0, 20.0, 1e-3).expect("these are limits")
    };
    for count in [1, 40] {
        let (bounds, mut clock) = (stairs(count), PathClock::new());
        measure(&format!("path clock, {count} pieces"), |_| {
            black_box(clock.step(black_box(&bounds), Drive::RUN));
        });
        measure(
            &format!("path clock, {count} pieces, a new speed each cycle"),
            |step| {
                let speed = 1.0 - 0.4 * (step % 2) as f64;
                black_box(clock.step(
                    black_box(&bounds),
                    Drive {
                        speed,
                        ..Drive::RUN
                    },
                ));
            },
        );
    }
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

/// One cycle; a motion that is done begins again.
fn step(set: &mut MotionSet) -> Option<MotionState> {
    let state = set.step(0, Drive::RUN);
    if state.is_none_or(|state| state.path.done) {
        set.reset();
    }
    black_box(state)
}

fn motions(arm: &Arm) {
    let start = arm.forward(&HOLD);
    let beside = |x, y, z| start.compose(&Pose::from_xyz_rpy([x, y, z], [0.1, 0.0, 0.0]));
    let to = beside(0.1, 0.1, 0.0);
    let through = [beside(0.05, 0.0, 0.0), beside(0.05, 0.08, 0.02), to];
    let leg = |segment, blend| Leg {
        scale: 0.02,
        blend,
        ..Leg::new(segment)
    };
    let line = leg(Segment::Line { to }, 0.0);
    let limits = Limits::of([0.01, 0.1, 1.0]);
    let poses = Leg {
        line: limits,
        turn: limits,
        ..line
    };
    let circle = Segment::Circle {
        via: beside(0.05, 0.05, 0.02).position,
        to,
        orientation: ArcOrientation::Even,
        angle: None,
    };
    let joints = Segment::Joints {
        to: [0.6, 0.2, 0.1, -1.2, 0.4, 0.7, 0.0, f64::NAN],
    };
    let back = Segment::Line {
        to: beside(0.0, 0.1, 0.0),
    };
    let rounded = [leg(Segment::Line { to }, 0.03), leg(back, 0.03), line];
    let all: [(&str, &[Leg<'_>], bool); 6] = [
        ("line, poses", &[poses], false),
        ("line", &[line], true),
        ("arc", &[leg(circle, 0.0)], true),
        (
            "spline",
            &[leg(Segment::Spline { through: &through }, 0.0)],
            true,
        ),
        ("point to point", &[leg(joints, 0.0)], true),
        ("three rounded lines", &rounded, true),
    ];
    for (name, legs, joints) in all {
        let mut set = motion(legs, joints);
        measure(&format!("a cycle of a motion: {name}"), |_| {
            step(&mut set);
        });
    }
    let configuration = arm.configuration(&HOLD);
    for arms in [1, 2] {
        let mut sets = vec![motion(&[poses], false); arms];
        measure(&format!("line and inverse kinematics, {arms} arms"), |_| {
            for set in &mut sets {
                let pose = step(set).map_or(start, |state| state.pose);
                let (branch, angle) = (configuration.branch, configuration.arm_angle);
                black_box(arm.inverse(&pose, angle, branch, &HOLD)).ok();
            }
        });
    }
}

fn main() {
    let arm = model().arm.expect("it has one");
    let pose = arm.forward(&HOLD);
    let configuration = arm.configuration(&HOLD);
    let (branch, angle) = (configuration.branch, configuration.arm_angle);
    println!("{:44}   best  median, ns", "LWR 4+");
    measure("forward kinematics", |_| {
        black_box(arm.forward(black_box(&HOLD)));
    });
    measure("forward kinematics and Jacobian", |_| {
        black_box(arm.jacobian(black_box(&HOLD)));
    });
    measure("inverse kinematics, one branch", |_| {
        black_box(arm.inverse(black_box(&pose), angle, branch, &HOLD)).ok();
    });
    measure("inverse kinematics, all branches", |_| {
        let all = arm.all_branches(black_box(&pose), angle, &HOLD);
        black_box(&all);
    });
    clocks();
    motions(&arm);
}
