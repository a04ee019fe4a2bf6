//! The closed forms and the follower, without a planner.

use super::*;
use proptest::prelude::*;
use std::vec::Vec;

fn limits(velocity: f64, acceleration: f64, jerk: f64) -> MotionLimits {
    MotionLimits {
        velocity,
        acceleration,
        jerk,
    }
}

/// The motion ends at rest at the goal, and every extremum keeps the limits or stems from the start state.
fn check(
    from: AxisState,
    phases: &Phases,
    goal: f64,
    limits: &MotionLimits,
) -> Result<(), TestCaseError> {
    prop_assert!(phases.0.iter().all(|(t, _)| *t >= 0.0), "{phases:?}");
    let end = phases.end(from);
    let a = limits.acceleration.max(from.acceleration.abs());
    let v = limits
        .velocity
        .max(from.velocity.abs())
        .max(from.coasting(limits.jerk).abs());
    // The rounding error of an acceleration grows with time, and so does that of a velocity.
    let t = phases.duration_s();
    let rounding = [1.0, t, t * t].map(|time| 1e-15 * a * time);
    let scale = from.position.abs() + goal.abs() + t * v;
    prop_assert!(
        (end.position - goal).abs() <= 1e-13 * scale + rounding[2],
        "{end:?} {goal}"
    );
    prop_assert!(end.velocity.abs() <= 1e-13 * v + rounding[1], "{end:?}");
    prop_assert!(end.acceleration.abs() <= rounding[0], "{end:?}");
    for corner in phases.extrema(from) {
        prop_assert!(corner.acceleration.abs() <= a * (1.0 + 1e-9), "{corner:?}");
        prop_assert!(corner.velocity.abs() <= v * (1.0 + 1e-9), "{corner:?}");
    }
    Ok(())
}

#[test]
fn a_long_motion_uses_every_limit() {
    // 1 m at 0.5 m/s, 2 m/s², 20 m/s³: distance/v + v/a + a/j.
    let phases = rest_to_rest(1.0, &limits(0.5, 2.0, 20.0));
    let duration_s: f64 = phases.iter().map(|(t, _)| t).sum();
    assert!((duration_s - (2.0 + 0.25 + 0.1)).abs() < 1e-12);
}

#[test]
fn a_short_motion_is_limited_by_jerk_only() {
    let phases = rest_to_rest(-1e-6, &limits(0.5, 2.0, 20.0));
    let duration_s: f64 = phases.iter().map(|(t, _)| t).sum();
    assert!((duration_s - 4.0 * (1e-6_f64 / 40.0).cbrt()).abs() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5000))]

    #[test]
    fn stop_and_go_arrives_within_the_limits(
        p in -3.0..3.0f64, v in -2.0..2.0f64, a in -1.0..1.0f64, goal in -3.0..3.0f64,
        vm in 0.01..3.0f64, am in 0.1..20.0f64, jm in 1.0..1000.0f64,
    ) {
        let limits = limits(vm, am, jm);
        prop_assume!(limits_are_valid(&limits));
        let from = AxisState { position: p, velocity: v * vm, acceleration: a * am };
        check(from, &stop_and_go(&from, goal, &limits), goal, &limits)?;
    }

    #[test]
    fn a_motion_of_any_length_arrives_within_the_limits(
        decade in -12.0..4.0f64, vm in 0.01..3.0f64, am in 0.1..20.0f64, jm in 1.0..1000.0f64,
    ) {
        let (distance, limits) = (10f64.powf(decade), limits(vm, am, jm));
        let phases = Phases::of(&[&rest_to_rest(distance, &limits)]);
        check(AxisState::at_rest(0.0), &phases, distance, &limits)?;
    }

    #[test]
    fn words_hold_the_whole_state_of_a_follower(goals in prop::collection::vec(-1.0..1.0f64, 1..20)) {
        let limits = limits(0.5, 2.0, 20.0);
        let mut follower = AxisFollower::at_rest(0.3);
        for goal in goals {
            for _ in 0..50 {
                let words: Vec<u64> = follower.words().map(f64::to_bits).to_vec();
                let mut copy = AxisFollower::from_words(&follower.words());
                prop_assert_eq!(copy.words().map(f64::to_bits).to_vec(), words);
                let step = |f: &mut AxisFollower| f.step(Some(goal), &limits, 1e-3, stop_and_go);
                prop_assert_eq!(step(&mut copy), step(&mut follower));
            }
        }
    }
}

#[test]
fn without_a_goal_it_comes_to_rest_and_goes_on_when_there_is_one() {
    let limits = limits(0.5, 2.0, 20.0);
    let mut follower = AxisFollower::at_rest(0.0);
    let mut step = |goal| follower.step(goal, &limits, 1e-3, stop_and_go);
    for _ in 0..300 {
        step(Some(1.0));
    }
    for _ in 0..1000 {
        step(None);
    }
    let resting = step(None);
    assert!(resting.rests() && resting.position < 1.0);
    assert_eq!(step(None), resting);
    for _ in 0..5000 {
        step(Some(1.0));
    }
    assert_eq!(step(Some(1.0)), AxisState::at_rest(1.0));
    assert!(follower.arrived());
}

#[test]
fn a_velocity_limit_of_zero_is_a_stop() {
    let mut follower = AxisFollower::at_rest(0.0);
    let still = limits(0.0, 2.0, 20.0);
    let before = follower.state();
    assert_eq!(follower.step(Some(1.0), &still, 1e-3, stop_and_go), before);
    assert!(!follower.arrived());
}
