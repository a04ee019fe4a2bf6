//! Motions of one axis against trajectories computed by the official Ruckig: `tests/data/trajectories`.
//!
//! Of its 140 cases (15 families) these are compared axis by axis, each with its own minimum duration, and with the
//! samples where the axis moves in its own time: `ptp ptpphase replan same short up uphigh updisc upmind upsync`
//! towards a goal, `stop upvel` towards a velocity. Not compared, because not supported: `updir` (24 axes: limits that
//! differ by direction), `up2 upvel2` (25 axes: no jerk limit), and 32 axes of `upvel` with an acceleration at the end.

use std::collections::BTreeMap;

use rcc_core::axis::{AxisFollower, AxisState, Phases, stop_and_go, to_velocity};
use rcc_core::path::MotionLimits;
use rcc_motion::goal::{GoalPlanKind, plan, plan_to};
use serde_json::Value;

fn axes(name: &str) -> Vec<Value> {
    let path = format!(
        "{}/../../tests/data/trajectories/{name}",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(path).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    file["axes"].as_array().unwrap().clone()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let numbers: Vec<f64> = value
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap_or(f64::INFINITY))
        .collect();
    numbers.try_into().unwrap()
}

fn state([position, velocity, acceleration]: [f64; 3]) -> AxisState {
    AxisState {
        position,
        velocity,
        acceleration,
    }
}

fn at(way: &Phases, start: AxisState, t_s: f64) -> AxisState {
    let (mut left, mut state) = (t_s, start);
    for (duration_s, jerk) in way.0 {
        if left < duration_s {
            return state.after(left, jerk);
        }
        left -= duration_s;
        state = state.after(duration_s, jerk);
    }
    state.after(left, 0.0)
}

#[test]
fn every_axis_matches_duration_and_samples_of_the_official_ruckig() {
    let mut compared: BTreeMap<String, (u32, u32)> = BTreeMap::new();
    let (mut worst_s, mut worst) = (0.0_f64, 0.0_f64);
    for axis in axes("ruckig_axes.json") {
        let [velocity, acceleration, jerk] = numbers(&axis["limits"]);
        let (from, to) = (state(numbers(&axis["from"])), state(numbers(&axis["to"])));
        let limits = MotionLimits {
            velocity,
            acceleration,
            jerk,
        };
        let way = if axis["interface"] == "velocity" {
            Phases::of(&[&to_velocity(&from, to.velocity, &limits)])
        } else {
            let (way, found) = plan_to(&from, &to, &limits).unwrap();
            assert_eq!(found, GoalPlanKind::Fastest, "{axis}");
            way
        };
        let difference = (way.duration_s() - axis["duration"].as_f64().unwrap()).abs();
        assert!(difference <= 1e-9, "{difference} s: {axis}");
        worst_s = worst_s.max(difference);
        let samples = axis["samples"].as_array().unwrap();
        for sample in samples {
            let [t, p, v, a] = numbers(sample);
            let here = at(&way, from, t);
            for (ours, theirs) in [
                (here.position, p),
                (here.velocity, v),
                (here.acceleration, a),
            ] {
                let off = (ours - theirs).abs() / theirs.abs().max(1.0);
                assert!(off <= 1e-8, "{ours} {theirs} at {t} s: {axis}");
                worst = worst.max(off);
            }
        }
        let row = compared
            .entry(axis["family"].as_str().unwrap().into())
            .or_default();
        *row = (row.0 + 1, row.1 + u32::from(!samples.is_empty()));
    }
    println!("worst: {worst_s:e} s, samples {worst:e}; {compared:?}");
    // Family: axes with a duration, axes with samples.
    let expected = [
        ("ptp", 95, 20),
        ("ptpphase", 43, 12),
        ("replan", 101, 20),
        ("same", 24, 6),
        ("short", 17, 6),
        ("stop", 77, 55),
        ("up", 42, 15),
        ("updisc", 18, 0),
        ("uphigh", 5, 3),
        ("upmind", 13, 0),
        ("upsync", 29, 12),
        ("upvel", 15, 5),
    ];
    let expected = expected.map(|(family, all, samples)| (family.to_string(), (all, samples)));
    assert_eq!(compared, expected.into());
}

#[test]
fn states_at_their_goal_within_rounding_always_have_a_plan() {
    for axis in axes("near_target.json") {
        let [velocity, acceleration, jerk, p, v, a, goal] = numbers(&axis);
        let limits = MotionLimits {
            velocity,
            acceleration,
            jerk,
        };
        let from = state([p, v, a]);
        let way = plan(&from, goal, &limits);
        let longest_s = stop_and_go(&state([0.0, v, a]), goal - p, &limits).duration_s();
        assert!(way.duration_s() <= longest_s, "{axis}");
        let end = way.end(from);
        assert!((end.position - goal).abs() < 1e-12, "{end:?} {axis}");
        assert!(way.extrema(from).all(|state| state.is_finite()));
    }
}

#[test]
fn a_follower_disturbed_within_rounding_arrives_again() {
    let limits = MotionLimits {
        velocity: 1.0,
        acceleration: 10.0,
        jerk: 500.0,
    };
    let mut follower = AxisFollower::at_rest(0.3);
    for goal in [0.3, 0.3 + 1e-16, 0.3 - 1e-12, 0.3 + 1e-9, 0.3] {
        for _ in 0..20 {
            follower.step(Some(goal), &limits, 1e-3, plan);
        }
        assert!(follower.arrived(), "{goal}");
    }
}
