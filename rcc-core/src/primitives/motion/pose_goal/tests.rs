//! Ways of the flange: limits, straight lines, new goals and null.

use super::*;
use crate::testing::PrimitiveHarness;
use rcc_testing::{Random, Rng};

fn bench() -> PrimitiveHarness {
    let mut bench = PrimitiveHarness::new("PoseGoal");
    bench.hold = Some([0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0]);
    let values = [
        ("velocity", 0.2),
        ("acceleration", 1.0),
        ("jerk", 10.0),
        ("angular_velocity", 1.0),
        ("angular_acceleration", 4.0),
        ("angular_jerk", 40.0),
        ("speed", 1.0),
    ];
    for (name, value) in values {
        bench.set_real(name, value);
    }
    bench.set_bool("stop", Some(false));
    bench.prepare().unwrap();
    bench
}

fn start(bench: &PrimitiveHarness) -> Pose {
    let hold = bench.hold.unwrap();
    let arm = bench.model.arm.unwrap();
    arm.forward(&hold)
}

fn pose(bench: &PrimitiveHarness) -> Pose {
    Pose::from_slots(bench.reals("pose", 7).try_into().unwrap())
}

#[test]
fn goes_from_the_hold_set_point_to_the_goal_and_to_another_on_the_way() {
    let mut bench = bench();
    let from = start(&bench);
    let relative = |xyz, rpy| from.compose(&Pose::from_xyz_rpy(xyz, rpy));
    bench.set_reals(
        "goal",
        &relative([0.1, 0.0, 0.0], [0.5, 0.0, 0.0]).to_slots(),
    );
    assert!(pose(bench.step()).distance_to(&from) < 1e-8);
    (0..300).for_each(|_| _ = bench.step());
    let other = relative([0.0, 0.1, 0.05], [0.0, -2.0, 1.0]);
    let mut last = pose(&bench);
    bench.set_reals("goal", &other.to_slots());
    for _ in 0..5000 {
        let now = pose(bench.step());
        assert!(last.distance_to(&now) <= 0.2e-3 * 1.3);
        assert!(last.angle_to(&now) <= 1e-3 * 1.3);
        last = now;
    }
    assert_eq!(bench.bool("done"), Some(true));
    assert!(last.distance_to(&other) < 1e-12 && last.angle_to(&other) < 1e-7);
}

#[test]
fn from_rest_it_keeps_its_limits_along_a_straight_line() {
    let mut bench = bench();
    let from = start(&bench);
    let [x, y, z] = from.position;
    let goal = Pose {
        position: [x + 0.1, y - 0.2, z + 0.2],
        ..from
    };
    bench.set_reals("goal", &goal.to_slots());
    let (mut last, mut fastest) = (from, 0.0_f64);
    for _ in 0..4000 {
        let now = pose(bench.step());
        let step = last.distance_to(&now);
        assert!(step <= 0.2e-3 * (1.0 + 1e-5), "{step}");
        fastest = fastest.max(step);
        let gone = from.distance_to(&now) / 0.3;
        let beside = [x + 0.1 * gone, y - 0.2 * gone, z + 0.2 * gone];
        let beside = norm(crate::vector::subtract(now.position, beside));
        assert!(beside < 1e-9, "{beside} m beside the line");
        last = now;
    }
    assert!(fastest > 0.199e-3, "it uses its limit: {fastest}");
    assert_eq!(bench.bool("done"), Some(true));
}

#[test]
fn a_null_goal_keeps_it_where_it_comes_to_rest() {
    let mut bench = bench();
    let from = start(&bench);
    (0..10).for_each(|_| _ = bench.step());
    assert!(pose(&bench).distance_to(&from) < 1e-15);
    assert_eq!(bench.bool("done"), Some(false));
}

#[test]
fn the_nearest_turn_continues_beyond_180_degrees() {
    let beyond = nearest_turn([-3.0, 0.0, 0.0], [3.1, 0.0, 0.0]);
    assert!((beyond[0] - (TAU - 3.0)).abs() < 1e-12);
    assert_eq!(
        nearest_turn([0.1, 0.0, 0.0], [0.2, 0.0, 0.0]),
        [0.1, 0.0, 0.0]
    );
    assert_eq!(nearest_turn([0.0; 3], [3.0, 0.0, 0.0]), [0.0; 3]);
}

/// An arm whose flange moves along and about `twist` (m/s, rad/s, in axes of the flange), with constant arm angle.
fn flying(arm: &Arm, joints: Joints, twist: [f64; 6]) -> ArmMotion {
    let from = arm.forward(&joints);
    let configuration = arm.configuration(&joints);
    let [x, y, z, a, b, c] = twist;
    let at = |t_s: f64| {
        let position = [x, y, z].map(|rate| rate * t_s);
        let orientation = exp([a, b, c].map(|rate| rate * t_s));
        let pose = from.compose(&Pose {
            position,
            orientation,
        });
        let (branch, angle) = (configuration.branch, configuration.arm_angle);
        arm.inverse(&pose, angle, branch, &joints).unwrap()
    };
    let (before, after) = (at(-1e-4), at(1e-4));
    let mut motion = ArmMotion::at_rest(joints);
    for joint in 0..7 {
        motion.velocity[joint] = (after[joint] - before[joint]) / 2e-4;
        motion.acceleration[joint] =
            (after[joint] - 2.0 * joints[joint] + before[joint]) / (1e-4 * 1e-4);
    }
    motion
}

#[test]
fn continues_a_motion_of_the_flange_from_its_pose_velocity_and_acceleration() {
    let mut random = Rng::with_seed(21);
    for _ in 0..100 {
        let twist = core::array::from_fn(|axis| {
            let most = if axis < 3 { 0.1 } else { 0.5 };
            random.uniform(-most, most)
        });
        let (mut goal, mut inverse) = (bench(), PrimitiveHarness::new("InverseKinematics"));
        let hold = goal.hold.unwrap();
        let arm = goal.model.arm.unwrap();
        // It is prepared where the arm is held, and begins elsewhere.
        let joints: Joints = core::array::from_fn(|joint| match joint {
            7 => 0.0,
            _ => hold[joint] + random.uniform(-0.2, 0.2),
        });
        let motion = flying(&arm, joints, twist);
        inverse.hold = goal.hold;
        inverse.prepare().unwrap();
        for bench in [&mut goal, &mut inverse] {
            bench.set_int("start", start::CONTINUE);
            bench.arm = Some(motion);
        }
        let from = arm.forward(&joints);
        let to = from.compose(&Pose::from_xyz_rpy([0.05, 0.0, -0.05], [0.1, 0.0, 0.0]));
        goal.set_reals("goal", &to.to_slots());
        let [mut last, mut rates] = [motion.position, motion.velocity];
        for cycle in 0..5000 {
            let pose = goal.step().reals("pose", 7).to_vec();
            let now = inverse.set_reals("pose", &pose).step().reals("joints", 7);
            for joint in 0..7 {
                let rate = (now[joint] - last[joint]) / 1e-3;
                let acceleration = (rate - rates[joint]) / 1e-3;
                let limit = goal.model.limits.acceleration_max[joint];
                assert!(acceleration.abs() <= limit, "{cycle}: {acceleration}");
                (last[joint], rates[joint]) = (now[joint], rate);
            }
        }
        assert_eq!(goal.bool("done"), Some(true));
        assert!(pose(&goal).distance_to(&to) < 1e-12);
        assert_eq!(arm.branch(&last), arm.branch(&joints));
        let angles = [last, joints].map(|joints| arm.arm_angle(&joints).unwrap());
        assert!((angles[0] - angles[1]).abs() < 1e-9, "{angles:?}");
    }
}

#[test]
fn from_rest_it_begins_where_the_arm_is_held_now() {
    let mut bench = bench();
    let mut there = bench.hold.unwrap();
    there[2] += 0.1;
    bench.arm = Some(ArmMotion::at_rest(there));
    let from = bench.model.arm.unwrap().forward(&there);
    for (begins, place) in [(0, start(&bench)), (start::CONTINUE, from)] {
        bench.cycle = 0;
        let first = pose(bench.set_int("start", begins).step());
        assert!(first.distance_to(&place) < 1e-12 && first.angle_to(&place) < 1e-7);
    }
}
