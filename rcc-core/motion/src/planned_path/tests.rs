//! Motions of joints checked from outside: by differences of the set-points, cycle by cycle, and by forward kinematics.

use rcc_core::frame::PrepareFault;
use rcc_core::path::{
    ArcOrientation, Leg, MotionBuilder, MotionFault, MotionLimits, MotionState, Motions,
    PathRequest, PathSegment, Quantity, RelativeTo, SpeedOverride, SpeedProfile, StopReserve,
};
use rcc_core::pose::Pose;
use rcc_core::vector;
use rcc_testing::arms::{HOLD as START, lwr};

use crate::{MotionSet, MotionSetBuilder};

mod sequences;

const DT: f64 = 1e-3;

pub(super) fn start() -> Pose {
    lwr().arm.unwrap().forward(&START)
}

pub(super) fn motion(legs: &[Leg<'_>]) -> Result<MotionSet, (u32, MotionFault)> {
    paced(legs, SpeedProfile::Uniform)
}

fn paced(legs: &[Leg<'_>], pace: SpeedProfile) -> Result<MotionSet, (u32, MotionFault)> {
    let (models, holds) = ([lwr()], [Some(START)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, DT, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs,
        pace,
    };
    match builder.path(0, &request) {
        Ok(()) => Ok(builder.finish().unwrap()),
        Err(PrepareFault::Motion { leg, fault, .. }) => Err((leg, fault)),
        Err(other) => panic!("{other:?}"),
    }
}

/// The states of a motion from rest to rest.
pub(super) struct FinishedRun {
    pub(super) states: Vec<MotionState>,
}

/// Runs a motion to its end; `speed_override` returns the override of each cycle.
pub(super) fn run(
    mut set: MotionSet,
    mut speed_override: impl FnMut(usize) -> SpeedOverride,
) -> FinishedRun {
    let mut states = Vec::new();
    for cycle in 0..60_000 {
        let state = set.step(0, speed_override(cycle)).unwrap();
        states.push(state);
        if state.path.done {
            // It stays done.
            let again = set.step(0, SpeedOverride::RUN).unwrap();
            assert!(again.path.done && again.joints == state.joints);
            return FinishedRun { states };
        }
    }
    panic!("never done: at {:?}", states.last().map(|state| state.path));
}

impl FinishedRun {
    pub(super) fn last(&self) -> &MotionState {
        self.states.last().unwrap()
    }

    /// Asserts that joints keep velocity, acceleration and jerk between cycles and stay in their range, and that joints
    /// and pose agree.
    pub(super) fn judge(&self, scale: f64) {
        let (model, arm) = (lwr(), lwr().arm.unwrap());
        let limits = model.limits;
        let mut history = [START; 4];
        for (cycle, state) in self.states.iter().enumerate() {
            assert!(arm.forward(&state.joints).distance_to(&state.pose) < 1e-9);
            assert!(arm.forward(&state.joints).angle_to(&state.pose) < 1e-9);
            history.rotate_left(1);
            history[3] = state.joints;
            for joint in 0..7 {
                let [a, b, c, d] = history.map(|joints| joints[joint]);
                assert!(d >= limits.lower[joint] && d <= limits.upper[joint]);
                let value = [
                    (d - c) / DT,
                    (d - 2.0 * c + b) / DT.powi(2),
                    (d - 3.0 * c + 3.0 * b - a) / DT.powi(3),
                ];
                let bounds = [
                    limits.velocity_max[joint],
                    limits.acceleration_max[joint],
                    limits.jerk_max[joint],
                ];
                for (order, (value, bound)) in value.iter().zip(bounds).enumerate() {
                    assert!(
                        value.abs() <= bound * scale * 1.001 + 1e-3,
                        "cycle {cycle}, joint {joint}, order {order}: {value} of {bound}"
                    );
                }
            }
        }
        let forward = self.states.windows(2);
        for pair in forward {
            assert!(pair[1].path.s >= pair[0].path.s && pair[1].progress >= pair[0].progress);
        }
    }
}

pub(super) fn free(_: usize) -> SpeedOverride {
    SpeedOverride::RUN
}

#[test]
fn point_to_point_goes_as_fast_as_its_slowest_joint_and_ends_exactly() {
    let to = [1.0, 0.9, 0.2, -0.9, 0.6, 0.6, -0.4, f64::NAN];
    let done = run(
        motion(&[Leg::new(PathSegment::Joints { to })]).unwrap(),
        free,
    );
    done.judge(1.0);
    assert_eq!(done.last().joints[..7], to[..7]);
    assert_eq!(done.last().progress, 1.0);
    // J1 dominates with 0.7 rad at 110°/s: at least 0.36 s, and not much more with its ramps.
    let time = done.states.len() as f64 * DT;
    assert!(time > 0.46 && time < 0.60, "{time}");
    let slow = Leg {
        scale: 0.1,
        ..Leg::new(PathSegment::Joints { to })
    };
    let slow = run(motion(&[slow]).unwrap(), free);
    slow.judge(0.1);
    assert!(slow.states.len() > 5 * done.states.len());
}

#[test]
fn point_to_point_to_a_pose_takes_the_nearest_branch_or_the_one_that_is_given() {
    let arm = lwr().arm.unwrap();
    // Rotated so that both wrist configurations are within the limits.
    let to = start().compose(&Pose::from_xyz_rpy([0.05, 0.1, 0.0], [0.2, 0.0, -0.8]));
    let to_pose = |branch| {
        Leg::new(PathSegment::JointsToPose {
            to,
            branch,
            status: None,
            turn: None,
        })
    };
    let near = run(motion(&[to_pose(None)]).unwrap(), free);
    assert!(near.last().pose.distance_to(&to) < 1e-9);
    assert_eq!(arm.branch(&near.last().joints), arm.branch(&START));
    let other = arm.branch(&START).index() ^ 4;
    let far = run(motion(&[to_pose(Some(other))]).unwrap(), free);
    far.judge(1.0);
    assert!(far.last().pose.distance_to(&to) < 1e-9);
    assert_eq!(arm.branch(&far.last().joints).index(), other);
}

#[test]
fn a_given_speed_is_kept_on_an_arc_and_refused_where_a_joint_cannot_follow() {
    let from = start();
    let at = |x, y| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0; 3]));
    let arc = |velocity| Leg {
        line: MotionLimits {
            velocity,
            ..MotionLimits::NONE
        },
        ..Leg::new(PathSegment::Circle {
            via: at(0.05, 0.05).position,
            to: at(0.0, 0.1),
            orientation: ArcOrientation::Even,
            angle: None,
        })
    };
    let done = run(motion(&[arc(0.1)]).unwrap(), free);
    done.judge(1.0);
    let fastest = done
        .states
        .iter()
        .map(|state| state.speed)
        .fold(0.0, f64::max);
    assert!((fastest - 0.1).abs() < 1e-9, "{fastest}");
    for state in &done.states {
        let radius = vector::norm(vector::subtract(
            state.pose.position,
            at(0.0, 0.05).position,
        ));
        assert!((radius - 0.05).abs() < 1e-12);
    }
    assert!(done.last().pose.distance_to(&at(0.0, 0.1)) < 1e-12);
    let fault = motion(&[arc(5.0)]).unwrap_err();
    let MotionFault::TooFast {
        possible,
        value,
        limit,
        ..
    } = fault.1
    else {
        panic!("{fault:?}")
    };
    assert!(possible > 0.01 && possible < 1.0);
    assert!(value > limit, "{fault:?}");
    // The speed that is reported as possible is possible.
    run(motion(&[arc(5.0 * possible * 0.999)]).unwrap(), free).judge(1.0);
    let slow = Leg {
        line: MotionLimits::of([0.1, 0.1, f64::NAN]),
        ..arc(0.1)
    };
    // 0.1 m/s on a radius of 0.05 m is 0.2 m/s².
    let fault = motion(&[slow]).unwrap_err();
    assert!(
        matches!(
            fault,
            (
                0,
                MotionFault::TooFast {
                    quantity: Quantity::Line,
                    order: 2,
                    ..
                }
            )
        ),
        "{fault:?}"
    );
}

#[test]
fn a_greater_velocity_makes_no_line_slower_even_if_it_is_too_short_to_reach_it() {
    let from = start();
    for (way, turn) in [(0.05, 0.0), (0.05, 0.3), (0.2, 0.2), (0.4, 0.0)] {
        let line = |velocity: f64| {
            motion(&[Leg {
                line: MotionLimits {
                    velocity,
                    ..MotionLimits::NONE
                },
                ..Leg::new(PathSegment::Line {
                    to: from.compose(&Pose::from_xyz_rpy([0.0, way, 0.0], [0.0, turn, 0.0])),
                })
            }])
        };
        let mut before = f64::INFINITY;
        let mut made = 0;
        for velocity in [0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0] {
            let Ok(line) = line(velocity) else { continue };
            let done = run(line, free);
            done.judge(1.0);
            let fastest = (done.states.iter()).fold(0.0_f64, |most, state| most.max(state.speed));
            assert!(
                fastest <= velocity * (1.0 + 1e-9),
                "{fastest} of {velocity}"
            );
            let cycles = done.states.len();
            assert!(
                // The speeds that are tried differ by 15 %.
                cycles as f64 <= 1.02 * before,
                "{way} m at {velocity}: {before} {cycles}"
            );
            before = before.min(cycles as f64);
            made += 1;
        }
        assert!(made > 3, "{made}");
    }
}

#[test]
fn a_velocity_that_cannot_be_kept_is_a_limit_for_a_time_optimal_motion() {
    let from = start();
    let arc = |velocity| Leg {
        line: MotionLimits {
            velocity,
            ..MotionLimits::NONE
        },
        ..Leg::new(PathSegment::Circle {
            via: from
                .compose(&Pose::from_xyz_rpy([0.05, 0.05, 0.0], [0.0; 3]))
                .position,
            to: from.compose(&Pose::from_xyz_rpy([0.0, 0.1, 0.0], [0.0; 3])),
            orientation: ArcOrientation::Even,
            angle: None,
        })
    };
    assert!(motion(&[arc(5.0)]).is_err());
    for velocity in [0.05, 5.0] {
        let done = run(
            paced(
                &[arc(velocity)],
                SpeedProfile::TimeOptimal(StopReserve::Keep),
            )
            .unwrap(),
            free,
        );
        done.judge(1.0);
        let fastest = (done.states.iter()).fold(0.0_f64, |most, state| most.max(state.speed));
        assert!(fastest <= velocity * 1.001, "{fastest} of {velocity}");
        assert!(fastest > 0.04, "{fastest}");
    }
}

#[test]
fn a_bend_may_take_nearly_all_of_the_jerk_limit_if_a_speed_is_given() {
    let from = start();
    let at = |x, y| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0; 3]));
    // On a circle of radius r the jerk is v³/r².
    let (radius, jerk) = (0.05_f64, 3.0_f64);
    let arc = |speed: f64| Leg {
        line: MotionLimits::of([speed, 5.0, jerk]),
        ..Leg::new(PathSegment::Circle {
            via: at(radius, radius).position,
            to: at(0.0, 2.0 * radius),
            orientation: ArcOrientation::Constant,
            angle: None,
        })
    };
    let greatest = (jerk * radius * radius).cbrt();
    run(motion(&[arc(0.96 * greatest)]).unwrap(), free).judge(1.0);
    let (_, fault) = motion(&[arc(greatest)]).unwrap_err();
    let MotionFault::TooFast {
        order: 3, possible, ..
    } = fault
    else {
        panic!("{fault:?}")
    };
    assert!(possible > 0.96 && possible < 1.0, "{possible}");
}

#[test]
fn an_arc_that_is_nearly_a_line_is_as_fast_as_one_or_refused() {
    let from = start();
    let at = |x, y| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0; 3]));
    let arc = |aside: f64| {
        let leg = Leg::new(PathSegment::Circle {
            via: at(aside, 0.02).position,
            to: at(0.0, 0.05),
            orientation: ArcOrientation::Even,
            angle: None,
        });
        motion(&[leg]).map(|motion| run(motion, free).states.len())
    };
    let line = motion(&[Leg::new(PathSegment::Line { to: at(0.0, 0.05) })]).unwrap();
    let line = run(line, free).states.len();
    let mut made = 0;
    for exponent in 0..36 {
        let aside = 1e-7 * 1.3_f64.powi(exponent);
        match arc(aside) {
            Ok(cycles) => {
                assert!(cycles < line + line / 10, "{aside}: {cycles} {line}");
                made += 1;
            }
            Err(fault) => assert_eq!(fault, (0, MotionFault::Collinear), "{aside}"),
        }
    }
    assert!((5..31).contains(&made), "{made}");
}

#[test]
fn a_whole_circle_comes_back_and_a_spline_passes_its_poses() {
    let from = start();
    let at = |x, y, turn| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [turn, 0.0, 0.0]));
    let circle = Leg::new(PathSegment::Circle {
        via: at(0.05, 0.05, 0.0).position,
        to: at(0.0, 0.1, 0.0),
        orientation: ArcOrientation::Constant,
        angle: Some(std::f64::consts::TAU),
    });
    let done = run(motion(&[circle]).unwrap(), free);
    done.judge(1.0);
    assert!(done.last().pose.distance_to(&from) < 1e-12);
    assert!((done.last().distance - std::f64::consts::TAU * 0.05).abs() < 1e-9);
    let through = [
        at(0.05, 0.05, 0.2),
        at(0.1, 0.0, 0.1),
        at(0.05, -0.08, -0.2),
    ];
    let spline = Leg {
        line: MotionLimits::of([0.05, f64::NAN, f64::NAN]),
        ..Leg::new(PathSegment::Spline { through: &through })
    };
    let done = run(motion(&[spline]).unwrap(), free);
    done.judge(1.0);
    for pose in &through {
        let near = done.states.iter().map(|state| state.pose.distance_to(pose));
        assert!(near.fold(1.0, f64::min) < 0.05 * DT);
    }
    for state in &done.states {
        assert!(state.speed <= 0.05 + 1e-12);
    }
}
