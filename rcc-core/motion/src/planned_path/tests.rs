//! Motions of joints checked from outside: by differences of the set-points, cycle by cycle, and by forward kinematics.

use rcc_core::frame::PrepareFault;
use rcc_core::path::{
    ArcOrientation, Leg, MotionBuilder, MotionFault, MotionLimits, MotionState, Motions,
    PathRequest, PathSegment, Quantity, RelativeTo, SpeedOverride, SpeedProfile,
};
use rcc_core::pose::Pose;
use rcc_core::vector;
use rcc_testing::arms::{HOLD as START, lwr};
use rcc_testing::{Random, Rng};

use crate::{MotionSet, MotionSetBuilder};

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

/// A pose near the start that the arm reaches easily.
fn near(random: &mut Rng) -> Pose {
    let mut around = |by: f64| random.uniform(-by, by);
    let turn = [around(0.25), around(0.25), around(0.25)];
    let way = [around(0.12), around(0.12), around(0.12)];
    start().compose(&Pose::from_xyz_rpy(way, turn))
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
            paced(&[arc(velocity)], SpeedProfile::TimeOptimal).unwrap(),
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

/// Legs of every kind, with blends.
fn all_kinds(blend: f64, through: &[Pose; 2]) -> [Leg<'_>; 5] {
    let from = start();
    let at = |x, y, z| from.compose(&Pose::from_xyz_rpy([x, y, z], [0.1, 0.0, 0.0]));
    let kinds = [
        PathSegment::Line {
            to: at(0.08, 0.0, 0.0),
        },
        PathSegment::Joints {
            to: [0.5, 0.6, -0.1, -1.5, 0.2, 0.9, 0.3, f64::NAN],
        },
        PathSegment::Line {
            to: at(0.0, 0.1, 0.02),
        },
        PathSegment::Circle {
            via: at(-0.05, 0.05, 0.0).position,
            to: at(-0.05, -0.05, 0.0),
            orientation: ArcOrientation::Even,
            angle: None,
        },
        PathSegment::Spline { through },
    ];
    kinds.map(|segment| Leg {
        blend,
        ..Leg::new(segment)
    })
}

fn two_poses() -> [Pose; 2] {
    let at = |x, y| start().compose(&Pose::from_xyz_rpy([x, y, 0.03], [0.0, 0.1, 0.0]));
    [at(0.0, -0.05), at(0.06, 0.0)]
}

#[test]
fn a_sequence_rests_at_every_end_without_zones_and_nowhere_with_them() {
    let poses = two_poses();
    let rests = |blend: f64| {
        let done = run(motion(&all_kinds(blend, &poses)).unwrap(), free);
        done.judge(1.0);
        assert!(done.last().pose.distance_to(&poses[1]) < 1e-9);
        assert_eq!(done.last().leg, 4);
        let moving = done.states.iter().map(|state| state.path.velocity > 0.0);
        let moving: Vec<bool> = moving.collect();
        moving.windows(2).filter(|pair| pair[0] && !pair[1]).count()
    };
    assert_eq!((rests(0.0), rests(0.03)), (5, 1));
}

#[test]
fn a_blended_rectangle_keeps_the_given_speed_and_is_faster_than_one_with_corners() {
    let at = |x, y| start().compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0; 3]));
    let time = |blend, velocity| {
        let corners = [at(0.1, 0.0), at(0.1, 0.15), at(-0.05, 0.15), at(-0.05, 0.0)];
        let legs = corners.map(|to| Leg {
            blend,
            line: MotionLimits::of([velocity, f64::NAN, f64::NAN]),
            ..Leg::new(PathSegment::Line { to })
        });
        let done = run(motion(&legs).unwrap(), free);
        done.judge(1.0);
        done.states.len()
    };
    let (corners, rounded) = (time(0.0, 0.1), time(0.03, 0.1));
    assert!(rounded < corners, "{rounded} {corners}");
}

#[test]
fn a_blend_stays_within_its_zone_of_the_corner() {
    let from = start();
    let at = |x, y| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0; 3]));
    let line = |to, blend| Leg {
        blend,
        ..Leg::new(PathSegment::Line { to })
    };
    let (corner, end) = (at(0.1, 0.0), at(0.1, 0.1));
    let done = run(motion(&[line(corner, 0.02), line(end, 0.0)]).unwrap(), free);
    done.judge(1.0);
    let nearest = done
        .states
        .iter()
        .map(|state| state.pose.distance_to(&corner))
        .fold(1.0, f64::min);
    assert!(nearest > 0.001 && nearest < 0.02, "{nearest}");
    for state in &done.states {
        let place = from.inverse().compose(&state.pose).position;
        let beside = place[1].abs().min((place[0] - 0.1).abs());
        assert!(beside < 0.01 && place[0] < 0.1 + 1e-9 && place[1] > -1e-9);
    }
}

#[test]
fn a_blend_that_is_smaller_than_requested_is_reported() {
    let from = start();
    let at = |x, y| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0; 3]));
    let line = |to, blend| Leg {
        blend,
        ..Leg::new(PathSegment::Line { to })
    };
    let told = |legs: &[Leg<'_>]| -> Vec<crate::ReducedBlend> {
        let motion = motion(legs).unwrap();
        motion.shortened().map(|(_, shortened)| shortened).collect()
    };
    let (there, aside) = (at(0.1, 0.0), at(0.1, 0.06));
    assert_eq!(told(&[line(there, 0.03), line(aside, 0.02)]), []);
    let [short] = told(&[line(there, 0.04), line(aside, 0.0)])[..] else {
        panic!("one");
    };
    assert_eq!((short.leg, short.asked_m), (0, 0.04));
    assert!((short.made_m - 0.03).abs() < 1e-9, "{short:?}");
}

#[test]
fn relative_goals_begin_where_the_leg_before_ended() {
    let relative = |relative, x, z| Leg {
        relative: Some(relative),
        ..Leg::new(PathSegment::Line {
            to: Pose::from_xyz_rpy([x, 0.0, z], [0.0; 3]),
        })
    };
    let legs = [
        relative(RelativeTo::Tool, 0.05, 0.0),
        relative(RelativeTo::Base, 0.0, 0.05),
    ];
    let done = run(motion(&legs).unwrap(), free);
    let want = start().compose(&Pose::from_xyz_rpy([0.05, 0.0, 0.0], [0.0; 3]));
    let [x, y, z] = want.position;
    let want = Pose {
        position: [x, y, z + 0.05],
        ..want
    };
    assert!(done.last().pose.distance_to(&want) < 1e-9 && done.last().pose.angle_to(&want) < 1e-9);
}

#[test]
fn a_path_that_the_arm_cannot_follow_is_refused_with_the_position() {
    let line = |to| [Leg::new(PathSegment::Line { to })];
    let away = start().compose(&Pose::from_xyz_rpy([0.0, 0.0, 2.0], [0.0; 3]));
    let fault = motion(&line(away)).unwrap_err();
    assert!(
        matches!(fault, (0, MotionFault::Unreachable { fraction }) if fraction > 0.0 && fraction < 1.0)
            || matches!(
                fault,
                (
                    0,
                    MotionFault::JointRange { .. } | MotionFault::Singular { .. }
                )
            ),
        "{fault:?}"
    );
    let mut to = START;
    (to[3], to[7]) = (-2.5, f64::NAN);
    let fault = motion(&[Leg::new(PathSegment::Joints { to })]).unwrap_err();
    assert!(
        matches!(fault, (0, MotionFault::JointRange { joint: 3, .. })),
        "{fault:?}"
    );
    (to[3], to[7]) = (-1.5, 0.3);
    let fault = motion(&[Leg::new(PathSegment::Joints { to })]).unwrap_err();
    assert_eq!(fault, (0, MotionFault::JointCount { joints: 7 }));
    (to[3], to[7]) = (f64::NAN, f64::NAN);
    let fault = motion(&[Leg::new(PathSegment::Joints { to })]).unwrap_err();
    assert_eq!(fault, (0, MotionFault::NotFinite));
    assert_eq!(
        motion(&[]).unwrap_err(),
        (0, MotionFault::Legs { count: 0 })
    );
    let same = Leg::new(PathSegment::Line { to: start() });
    let nowhere = run(motion(&[same]).unwrap(), free);
    assert_eq!(nowhere.states.len(), 1);
}

#[test]
fn random_sequences_keep_every_limit_under_random_speed_pause_and_stop() {
    let mut random = Rng::with_seed(7);
    let (mut made, mut refused) = (0, 0);
    while made < 60 {
        let poses = two_poses();
        let through = [near(&mut random), near(&mut random)];
        let mut legs = all_kinds(random.uniform(0.0, 0.05), &poses).to_vec();
        let count = 1 + (random.unit() * 4.0) as usize;
        legs.rotate_left(count);
        legs.truncate(1 + count);
        legs.push(Leg::new(PathSegment::Line {
            to: near(&mut random),
        }));
        legs.push(Leg {
            blend: 0.02,
            scale: random.uniform(0.2, 1.0),
            ..Leg::new(PathSegment::Spline { through: &through })
        });
        legs.push(Leg::new(PathSegment::Line {
            to: near(&mut random),
        }));
        let Ok(set) = motion(&legs) else {
            refused += 1;
            assert!(refused < 60);
            continue;
        };
        made += 1;
        let stop_at = if random.unit() < 0.3 {
            (random.unit() * 3000.0) as usize
        } else {
            usize::MAX
        };
        let mut speed_override = SpeedOverride::RUN;
        let done = run(set, |cycle| {
            if random.unit() < 0.01 {
                speed_override.speed = random.uniform(0.05, 1.0);
                speed_override.pause = random.unit() < 0.2 && cycle < 20_000;
            }
            speed_override.stop = cycle >= stop_at;
            speed_override
        });
        done.judge(1.0);
    }
}
