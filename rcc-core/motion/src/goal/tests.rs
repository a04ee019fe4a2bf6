//! Random goals, stops and speeds: the motion of an axis is checked by its states alone.

use rcc_core::axis::AxisFollower;
use rcc_testing::{Random, Rng};

use super::*;

const DT_S: f64 = 1e-3;

/// Runs one cycle and asserts that velocity, acceleration and jerk keep the limits and that the position follows from
/// them.
fn checked(follower: &mut AxisFollower, goal: Option<f64>, speed: f64, limits: &MotionLimits) {
    let before = follower.state();
    let scaled = MotionLimits {
        velocity: limits.velocity * speed,
        ..*limits
    };
    let now = follower.step(goal, &scaled, DT_S, plan);
    let within = |value: f64, limit: f64| value.abs() <= 1.001 * limit + 1e-3;
    let jerk = (now.acceleration - before.acceleration) / DT_S;
    let all = within(now.velocity, limits.velocity)
        && within(now.acceleration, limits.acceleration)
        && within(jerk, limits.jerk);
    let expected = before.after(DT_S, 0.0);
    let rounding = 1e-14 * (1.0 + now.position.abs());
    let joined = (now.position - expected.position).abs()
        <= limits.jerk * DT_S.powi(3) / 6.0 * 1.001 + rounding
        && (now.velocity - expected.velocity).abs()
            <= limits.jerk * DT_S * DT_S / 2.0 * 1.001 + 1e-12;
    assert!(
        all && joined && now.is_finite(),
        "{before:?} {now:?} {goal:?} {speed} {limits:?}"
    );
    assert_eq!(
        follower.arrived(),
        speed > 0.0 && now.rests() && Some(now.position) == goal,
        "{now:?} {goal:?}"
    );
}

/// Returns a power of ten; its exponent is in `low`..`high`.
fn decade(random: &mut Rng, low: f64, high: f64) -> f64 {
    10_f64.powf(random.uniform(low, high))
}

fn limits(random: &mut Rng) -> MotionLimits {
    MotionLimits {
        velocity: decade(random, -1.0, 0.7),
        acceleration: decade(random, 0.0, 1.7),
        jerk: decade(random, 1.5, 3.0),
    }
}

#[test]
fn a_hundred_thousand_sequences_of_goals_keep_every_limit_and_arrive() {
    let mut random = Rng::with_seed(11);
    for _ in 0..100_000 {
        let limits = limits(&mut random);
        let mut follower = AxisFollower::at_rest(random.uniform(-2.0, 2.0));
        let (mut goal, mut speed) = (None, 1.0);
        for _ in 0..6 {
            match random.unit() {
                kind if kind < 0.2 => goal = None,
                kind if kind < 0.4 => {
                    speed = [0.0, 1.0, random.unit()][(3.0 * random.unit()) as usize]
                }
                kind if kind < 0.7 => {
                    let near = limits.velocity * decade(&mut random, -9.0, 0.0);
                    goal = Some(follower.state().position + near * random.uniform(-1.0, 1.0));
                }
                _ => goal = Some(random.uniform(-2.0, 2.0)),
            }
            for _ in 0..(80.0 * random.unit()) as usize {
                checked(&mut follower, goal, speed, &limits);
            }
        }
        let goal = random.uniform(-2.0, 2.0);
        let longest_s = stop_and_go(&follower.state(), goal, &limits).duration_s();
        // Do not always wait for the arrival: the distances are long.
        if random.unit() < 0.05 {
            for _ in 0..(longest_s / DT_S) as usize + 2 {
                checked(&mut follower, Some(goal), 1.0, &limits);
            }
            assert!(follower.arrived(), "{follower:?} {goal} {longest_s}");
        }
    }
}

#[test]
fn replanning_on_the_way_does_not_make_the_motion_longer() {
    let mut random = Rng::with_seed(14);
    for _ in 0..200_000 {
        let limits = limits(&mut random);
        let mut signed = |limit: f64| limit * random.uniform(-0.7, 0.7);
        let from = AxisState {
            position: 0.0,
            velocity: signed(limits.velocity),
            acceleration: signed(limits.acceleration),
        };
        if most_velocity(&from, &limits) > limits.velocity {
            continue;
        }
        let goal =
            limits.velocity * decade(&mut random, -6.0, 0.5) * random.uniform(-1.0, 1.0).signum();
        let way = plan(&from, goal, &limits);
        // Anywhere, or near a corner, where rounding decides which profiles exist.
        let corner: usize = (10.0 * random.unit()) as usize;
        let begin_s: f64 = way.0.iter().take(corner).map(|(t, _)| t).sum();
        let gone_s = if random.unit() < 0.5 {
            way.duration_s() * random.unit()
        } else {
            (begin_s + decade(&mut random, -16.0, -3.0)).min(way.duration_s())
        };
        let (mut left_s, mut state) = (gone_s, from);
        for (duration_s, jerk) in way.0 {
            let t_s = left_s.min(duration_s);
            left_s -= t_s;
            state = state.after(t_s, jerk);
        }
        let again_s = plan(&state, goal, &limits).duration_s();
        let longer_s = again_s - (way.duration_s() - gone_s);
        // A residual distance of rounding takes its cube root in time.
        assert!(
            longer_s <= 1e-4,
            "{longer_s} s: {state:?} {goal} {limits:?} {way:?}"
        );
    }
}

#[test]
fn a_goal_that_moves_a_little_in_every_cycle_is_followed_within_the_limits() {
    let mut random = Rng::with_seed(12);
    for _ in 0..500 {
        let limits = limits(&mut random);
        let mut follower = AxisFollower::at_rest(0.0);
        let (mut goal, noise) = (0.1, decade(&mut random, -9.0, -2.0));
        for _ in 0..500 {
            goal += noise * random.uniform(-1.0, 1.0);
            checked(&mut follower, Some(goal), 1.0, &limits);
        }
    }
}

#[test]
fn a_speed_that_changes_leads_neither_back_nor_beyond_the_goal() {
    let mut random = Rng::with_seed(13);
    for _ in 0..3000 {
        let limits = limits(&mut random);
        let mut follower = AxisFollower::at_rest(0.0);
        let (goal, mut speed) = (limits.velocity * decade(&mut random, -2.0, 0.5), 1.0);
        for cycle in 0..3000 {
            if random.unit() < 0.01 {
                speed =
                    [0.0, 1.0, random.unit(), 0.1 * random.unit()][(4.0 * random.unit()) as usize];
            }
            let before = follower;
            checked(&mut follower, Some(goal), speed, &limits);
            let now = follower.state();
            assert!(
                now.velocity >= -1e-9 && now.position <= goal + 1e-9,
                "{cycle} {before:?} {follower:?} {goal} {speed} {limits:?}"
            );
        }
    }
}

#[test]
fn without_a_motion_to_the_goal_there_is_a_reason_and_a_stop() {
    let fine = MotionLimits {
        velocity: 1.0,
        acceleration: 10.0,
        jerk: 500.0,
    };
    let moving = AxisState {
        position: 0.0,
        velocity: 0.5,
        acceleration: 0.0,
    };
    for bad in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
        let limits = MotionLimits {
            acceleration: bad,
            ..fine
        };
        assert_eq!(plan(&moving, 1.0, &limits), Phases::default(), "{bad}");
        let limits = MotionLimits { jerk: bad, ..fine };
        let refused = plan_to(&moving, &AxisState::at_rest(1.0), &limits);
        assert_eq!(refused, Err(GoalFault::Limits), "{bad}");
    }
    let stop = Phases::of(&[&to_velocity(&moving, 0.0, &fine)]);
    assert_eq!(plan(&moving, f64::NAN, &fine), stop);
    let nowhere = AxisState::at_rest(f64::INFINITY);
    assert_eq!(plan(&nowhere, 1.0, &fine), Phases::default());
    for (from, to) in [(moving, nowhere), (nowhere, moving)] {
        assert_eq!(plan_to(&from, &to, &fine), Err(GoalFault::NotFinite));
    }
    let far = [-1.5e308, 1.5e308].map(AxisState::at_rest);
    assert_eq!(plan_to(&far[0], &far[1], &fine), Err(GoalFault::NotFinite));
}

/// Limits, a state within twice their size (one in four at rest), and a goal: sizes within 10^±`spread`.
fn extreme(random: &mut Rng, spread: f64) -> (AxisState, AxisState, MotionLimits) {
    let mut size = || decade(random, -spread, spread);
    let limits = MotionLimits {
        velocity: size(),
        acceleration: size(),
        jerk: size(),
    };
    let goal = AxisState::at_rest(size());
    let mut signed = |limit: f64| 2.0 * limit * random.uniform(-1.0, 1.0);
    let from = AxisState {
        position: 0.0,
        velocity: signed(limits.velocity),
        acceleration: signed(limits.acceleration),
    };
    let rests = random.once_in(4);
    (
        if rests { AxisState::at_rest(0.0) } else { from },
        goal,
        limits,
    )
}

#[test]
fn an_extreme_goal_is_reached_or_refused_with_a_reason() {
    let (mut random, mut refused) = (Rng::with_seed(15), 0);
    for _ in 0..4000 {
        let (from, goal, limits) = extreme(&mut random, 2.0);
        let (way, _) = match plan_to(&from, &goal, &limits) {
            Ok(planned) => planned,
            Err(fault) => {
                assert_eq!(fault, GoalFault::Inexact, "{from:?} {goal:?} {limits:?}");
                refused += 1;
                continue;
            }
        };
        let end = way.end(from);
        let length = goal.position + most_velocity(&from, &limits) * way.duration_s();
        assert!(
            (end.position - goal.position).abs() <= 1e-8 * length,
            "{end:?} {from:?} {goal:?} {limits:?}"
        );
    }
    assert!(refused < 40, "{refused} of 4000 are refused");
}
