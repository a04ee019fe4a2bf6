//! Cycles of motions: the path clock alone, a motion of each kind, and whole nets. See the parent module.

use std::hint::black_box;

use bytemuck::Zeroable;
use rcc_core::frame::DeviceInput;
use rcc_core::message::Measurement;
use rcc_core::path::{
    ArcOrientation, Leg, MotionBuilder, Motions, PathRequest, PathSegment, SpeedOverride,
    SpeedProfile, StopReserve,
};
use rcc_engine::net::{Evaluation, Net};
use rcc_language::compile_for;
use rcc_language::devices::{CellDevice, DeviceTable};
use rcc_motion::{MotionSet, MotionSetBuilder, PathBounds, PathClock, PathPiece};

use super::{HOLD, NamedSubject, SubjectGroup, model, offset_from_start};

const PERIOD_S: f64 = 1e-3;

pub(super) fn clock() -> SubjectGroup {
    let mut subjects = Vec::new();
    for (name, count) in [("one piece", 1), ("40 pieces", 40)] {
        let piece = |k| PathPiece {
            end_s: 1e4 * f64::from(k) / f64::from(count),
            velocity: if k % 2 == 0 { 0.5 } else { 0.2 },
        };
        let pieces: Vec<PathPiece> = (1..=count).map(piece).collect();
        let bounds = PathBounds::new(&pieces, 2.0, 20.0, PERIOD_S).expect("these are limits");
        let (same, mut clock) = (bounds.clone(), PathClock::new());
        subjects.push(NamedSubject::new(format!("{name}, as before"), move || {
            black_box(clock.step(black_box(&same), SpeedOverride::RUN));
        }));
        let (mut clock, mut slow) = (PathClock::new(), false);
        let name = format!("{name}, replanned each cycle for a new speed");
        subjects.push(NamedSubject::new(name, move || {
            slow = !slow;
            let drive = SpeedOverride {
                speed: if slow { 0.6 } else { 1.0 },
                ..SpeedOverride::RUN
            };
            black_box(clock.step(black_box(&bounds), drive));
        }));
    }
    SubjectGroup {
        name: "the path clock",
        subjects,
    }
}

fn motion(legs: &[Leg<'_>], pace: SpeedProfile) -> MotionSet {
    let (models, holds) = ([model()], [Some(HOLD)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, PERIOD_S, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs,
        pace,
    };
    builder.path(0, &request).expect("the arm can do this");
    builder.finish().expect("it was asked for")
}

/// Returns a subject that runs cycles of a motion, which starts again at its end.
fn running(name: &str, legs: &[Leg<'_>]) -> NamedSubject {
    paced(name, legs, SpeedProfile::Uniform)
}

fn paced(name: &str, legs: &[Leg<'_>], pace: SpeedProfile) -> NamedSubject {
    let mut set = motion(legs, pace);
    NamedSubject::new(name, move || {
        let state = set.step(0, SpeedOverride::RUN);
        if state.is_none_or(|state| state.path.done) {
            set.reset();
        }
        black_box(state);
    })
}

pub(super) fn motions() -> SubjectGroup {
    let to = offset_from_start(0.1, 0.1, 0.0);
    let through = [
        offset_from_start(0.05, 0.0, 0.0),
        offset_from_start(0.05, 0.08, 0.02),
        to,
    ];
    // Slow, so that a run is much longer than its acceleration and deceleration.
    let leg = |segment, blend| Leg {
        scale: 0.02,
        blend,
        ..Leg::new(segment)
    };
    let line = leg(PathSegment::Line { to }, 0.0);
    let circle = PathSegment::Circle {
        via: offset_from_start(0.05, 0.05, 0.02).position,
        to,
        orientation: ArcOrientation::Even,
        angle: None,
    };
    let spline = PathSegment::Spline { through: &through };
    let joints = PathSegment::Joints {
        to: [0.6, 0.2, 0.1, -1.2, 0.4, 0.7, 0.0, f64::NAN],
    };
    let back = PathSegment::Line {
        to: offset_from_start(0.0, 0.1, 0.0),
    };
    let rounded = [leg(PathSegment::Line { to }, 0.03), leg(back, 0.03), line];
    SubjectGroup {
        name: "a cycle of a motion",
        subjects: vec![
            running("line, joints", &[line]),
            running("arc, joints", &[leg(circle, 0.0)]),
            running("spline, joints", &[leg(spline, 0.0)]),
            running("point to point", &[leg(joints, 0.0)]),
            running("three rounded lines, joints", &rounded),
            paced(
                "three rounded lines, fastest",
                &rounded,
                SpeedProfile::TimeOptimal(StopReserve::Keep),
            ),
        ],
    }
}

/// Returns a net that moves each of these arms along a line of its own, as `configs/nets/guarded-line.yaml` does.
fn lines(arms: &[&str], done: &str) -> String {
    let mut text = String::from("net: lines\nprimitives:\n  cancel: {type: Cancel}\n");
    for (index, arm) in arms.iter().enumerate() {
        let [x, y, z] = offset_from_start(0.1, 0.1, 0.0).position;
        text += &format!(
            "  move{index}: {{type: LinearMotion, parameters: {{device: {arm}, \
             to: {{xyz: [{x}, {y}, {z}], rpy: [0, deg(170), 0]}}, velocity: 0.005 m/s, \
             acceleration: 0.5 m/s^2, jerk: 5 m/s^3}}, inputs: {{stop: cancel.requested}}}}\n  \
             ik{index}: {{type: InverseKinematics, parameters: {{device: {arm}}}, \
             inputs: {{pose: move{index}.pose}}}}\n  \
             robot{index}: {{type: JointPositionCommand, parameters: {{device: {arm}}}, \
             inputs: {{position: ik{index}.joints}}}}\n"
        );
    }
    text + done
}

pub(super) fn nets() -> SubjectGroup {
    let device = |name: &str| CellDevice {
        name: name.to_string(),
        model: model(),
        channels: Default::default(),
    };
    let table = DeviceTable {
        fingerprint: 0,
        period_ns: 1_000_000,
        devices: vec![device("left"), device("right")],
    };
    let mut measurement = Measurement::zeroed();
    (measurement.joints, measurement.position, measurement.hold) = (7, HOLD, HOLD);
    let input = DeviceInput {
        present: true,
        measurement,
    };
    let running = |name: &str, arms: &[&str], done: &str| {
        let net = compile_for(&lines(arms, done), "lines.yaml", &table);
        let plan = net.unwrap_or_else(|faults| panic!("{faults}")).plan;
        let (models, holds) = ([model(), model()], [Some(HOLD), Some(HOLD)]);
        let mut net = Net::build(plan, &models, 0, &holds, PERIOD_S).expect("a good plan");
        NamedSubject::new(name, move || {
            let evaluation = net.evaluate(&models, &[input, input], PERIOD_S);
            if evaluation != Evaluation::Running {
                assert_eq!(evaluation, Evaluation::Terminated, "the line is possible");
                net.reset();
            }
            black_box(net.outputs());
        })
    };
    SubjectGroup {
        name: "a cycle of a net: line, inverse kinematics, command",
        subjects: vec![
            running(
                "one arm",
                &["left"],
                "  end: {type: Termination, inputs: {done: move0.done}}\n",
            )
            .within(1000.0),
            running(
                "two arms",
                &["left", "right"],
                "  both: {type: And, inputs: {a: move0.done, b: move1.done}}\n  \
                 end: {type: Termination, inputs: {done: both.out}}\n",
            ),
        ],
    }
}
