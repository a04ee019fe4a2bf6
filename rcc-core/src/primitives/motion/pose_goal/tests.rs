//! Ways of the flange: limits, straight lines, new goals and null.

use super::*;
use crate::testing::PrimitiveHarness;

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
