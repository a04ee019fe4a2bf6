//! Sequences of legs: rests and blends between them, relative goals, refusals, and random ones.

use rcc_testing::{Random, Rng};

use super::*;

/// A pose near the start that the arm reaches easily.
fn near(random: &mut Rng) -> Pose {
    let mut around = |by: f64| random.uniform(-by, by);
    let turn = [around(0.25), around(0.25), around(0.25)];
    let way = [around(0.12), around(0.12), around(0.12)];
    start().compose(&Pose::from_xyz_rpy(way, turn))
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
fn a_blend_is_metres_of_the_flange_where_rotation_defines_the_length() {
    let from = start();
    let at = |x, y, yaw| from.compose(&Pose::from_xyz_rpy([x, y, 0.0], [0.0, 0.0, yaw]));
    let line = |to, blend| Leg {
        blend,
        ..Leg::new(PathSegment::Line { to })
    };
    // 100 mm and a quarter turn: 0.39 m of s.
    let quarter = core::f64::consts::FRAC_PI_2;
    let (corner, end) = (at(0.1, 0.0, quarter), at(0.1, 0.1, quarter));
    let set = motion(&[line(corner, 0.02), line(end, 0.0)]).unwrap();
    assert_eq!(set.shortened().count(), 0);
    let done = run(set, free);
    done.judge(1.0);
    let mut places = done.states.iter().map(|state| {
        let place = from.inverse().compose(&state.pose);
        place.position
    });
    let [x, ..] = places.find(|place| place[1].abs() > 1e-9).unwrap();
    assert!((0.08..0.083).contains(&x), "20 mm before the corner: {x}");
    // At most half of the leg, in metres.
    let made_m = |legs: &[Leg<'_>]| -> Vec<f64> {
        let motion = motion(legs).unwrap();
        motion.shortened().map(|(_, blend)| blend.made_m).collect()
    };
    let [half] = made_m(&[line(corner, 0.06), line(end, 0.0)])[..] else {
        panic!("one");
    };
    assert!((half - 0.05).abs() < 1e-9, "{half}");
    // A turn on the spot has no metres.
    let (turned, ahead) = (at(0.0, 0.0, 0.5), at(0.1, 0.0, 0.5));
    assert_eq!(made_m(&[line(turned, 0.02), line(ahead, 0.0)]), [0.0]);
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
