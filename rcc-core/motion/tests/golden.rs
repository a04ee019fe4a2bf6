//! Motions of one axis against trajectories computed by the official Ruckig: `tests/data/trajectories`.
//!
//! Of its 140 cases (15 families) these are compared axis by axis, each with its own minimum duration, and with the
//! samples where the axis moves in its own time: `ptp ptpphase replan same short up uphigh updisc upmind upsync`
//! towards a goal, `stop upvel` towards a velocity. Not compared, because not supported: `updir` (24 axes: limits that
//! differ by direction), `up2 upvel2` (25 axes: no jerk limit), and 32 axes of `upvel` with an acceleration at the end.

use std::collections::BTreeMap;

use assert_no_alloc::assert_no_alloc;
use rcc_core::axis::{AxisFollower, AxisState, AxisTask, Phases, stop_and_go, to_velocity};
use rcc_core::path::{MotionLimits, Motions};
use rcc_motion::MotionSetBuilder;
use rcc_motion::goal::{GoalPlanKind, plan, plan_to};
use rcc_testing::{Random, Rng};
use serde_json::Value;

#[cfg(debug_assertions)]
#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

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

/// Plans motions that end together, as `JointGoal` does with `synchronize: time`.
fn together(tasks: &[AxisTask]) -> Vec<Phases> {
    let mut motions = MotionSetBuilder::new(&[], &[], 1e-3, 0).finish().unwrap();
    let mut ways = vec![Phases::default(); tasks.len()];
    assert_no_alloc(|| motions.plan_axes(tasks, &mut ways));
    ways
}

/// Asserts that a motion leads to its goal within its limits, or within what its start makes inevitable.
fn assert_kept(task: &AxisTask, way: &Phases) {
    let AxisTask { from, goal, limits } = task;
    let end = way.end(*from);
    let inevitable = from.velocity.abs().max(from.coasting(limits.jerk).abs());
    let velocity = limits.velocity.max(inevitable);
    let range = (goal - from.position).abs() + velocity * way.duration_s();
    assert!(
        (end.position - goal).abs() <= 1e-9 * range,
        "{task:?} {end:?}"
    );
    assert!(
        end.velocity.abs().max(end.acceleration.abs()) <= 1e-8,
        "{task:?} {end:?}"
    );
    let acceleration = limits.acceleration.max(from.acceleration.abs()) * (1.0 + 1e-9);
    for corner in way.extrema(*from) {
        let kept = corner.velocity.abs() <= velocity * (1.0 + 1e-9)
            && corner.acceleration.abs() <= acceleration;
        assert!(kept, "{task:?} {corner:?}");
    }
    for (duration_s, jerk) in way.0 {
        let kept = duration_s >= 0.0 && jerk.abs() <= limits.jerk * (1.0 + 1e-9);
        assert!(kept, "{task:?} {way:?}");
    }
}

/// The tasks of a case, which has the same keys as the file.
fn tasks_of(case: &Value) -> Vec<AxisTask> {
    let all = |key: &str| case[key].as_array().unwrap();
    let number = |key: &str, axis: usize| all(key)[axis].as_f64().unwrap();
    let task = |axis: usize| AxisTask {
        from: state(numbers(&all("from")[axis])),
        goal: number("goal", axis),
        limits: MotionLimits {
            velocity: number("velocity", axis),
            acceleration: number("acceleration", axis),
            jerk: number("jerk", axis),
        },
    };
    (0..all("goal").len()).map(task).collect()
}

#[test]
fn axes_that_end_together_take_as_long_as_those_of_the_official_ruckig() {
    let (mut from_rest, mut in_motion, mut worst) = (0, 0, 0.0_f64);
    for case in axes("ruckig_together.json") {
        let tasks = tasks_of(&case);
        let ways = together(&tasks);
        let durations: Vec<f64> = ways.iter().map(Phases::duration_s).collect();
        let end_s = durations.iter().copied().fold(0.0, f64::max);
        for ((task, way), duration_s) in tasks.iter().zip(&ways).zip(&durations) {
            assert_kept(task, way);
            let stays = task.from.rests() && task.from.position == task.goal;
            assert!(
                stays || (duration_s - end_s).abs() <= 1e-9 * end_s,
                "{durations:?}: {case}"
            );
        }
        let ratio = end_s / case["duration"].as_f64().unwrap();
        let rests = tasks.iter().all(|task| task.from.rests());
        match rests {
            true => from_rest += 1,
            false => in_motion += 1,
        }
        println!("{} {}: {ratio}", case["case"], case["family"]);
        assert!((ratio - 1.0).abs() <= 1e-9 || !rests, "{ratio}: {case}");
        worst = worst.max(ratio);
    }
    println!("{from_rest} from rest, {in_motion} in motion, at most {worst} of Ruckig's time");
    assert!(worst <= 1.001, "{worst}");
    assert_eq!((from_rest, in_motion), (29, 19));
}

fn random_limits(random: &mut Rng) -> MotionLimits {
    MotionLimits {
        velocity: random.uniform(0.5, 3.0),
        acceleration: random.uniform(1.0, 20.0),
        jerk: random.uniform(20.0, 1000.0),
    }
}

#[test]
fn random_axes_in_motion_always_end_together() {
    let mut random = Rng::with_seed(3);
    for _ in 0..20_000 {
        let mut tasks = [AxisTask::NONE; 7];
        for task in &mut tasks {
            let limits = random_limits(&mut random);
            let moving = !random.once_in(4);
            let share = |random: &mut Rng| f64::from(u8::from(moving)) * random.uniform(-0.9, 0.9);
            let acceleration = share(&mut random) * limits.acceleration;
            // Reducing the acceleration to 0 adds a²/2j to the velocity; the sum is within its limit.
            let left = limits.velocity - acceleration * acceleration / (2.0 * limits.jerk);
            *task = AxisTask {
                from: AxisState {
                    position: random.uniform(-2.0, 2.0),
                    velocity: share(&mut random) * left.max(0.0),
                    acceleration: if left > 0.0 { acceleration } else { 0.0 },
                },
                goal: random.uniform(-2.0, 2.0),
                limits,
            };
        }
        let ways = together(&tasks);
        let end_s = ways.iter().map(Phases::duration_s).fold(0.0, f64::max);
        for (task, way) in tasks.iter().zip(&ways) {
            assert_kept(task, way);
            let late_s = end_s - way.duration_s();
            assert!(late_s <= 1e-9 * end_s, "{late_s} of {end_s}: {tasks:?}");
        }
    }
}

#[test]
fn a_lower_speed_in_motion_makes_no_axis_reverse_although_all_end_together() {
    let mut random = Rng::with_seed(5);
    let mut slowed = 0;
    for _ in 0..20_000 {
        let mut tasks = [AxisTask::NONE; 7];
        let share = random.uniform(0.02, 0.9);
        for task in &mut tasks {
            let limits = random_limits(&mut random);
            // On its way to its goal with the full speed, at any time.
            let goal = random.uniform(-2.0, 2.0);
            let way = plan(&AxisState::at_rest(0.0), goal, &limits);
            let from = at(
                &way,
                AxisState::at_rest(0.0),
                random.uniform(0.0, 0.9) * way.duration_s(),
            );
            let velocity = share * limits.velocity;
            let limits = MotionLimits { velocity, ..limits };
            *task = AxisTask { from, goal, limits };
        }
        let ways = together(&tasks);
        let end_s = ways.iter().map(Phases::duration_s).fold(0.0, f64::max);
        for (task, way) in tasks.iter().zip(&ways) {
            assert_kept(task, way);
            let late_s = end_s - way.duration_s();
            // It already brakes into its goal.
            let stop = Phases::of(&[&to_velocity(&task.from, 0.0, &task.limits)]);
            let stops_there = (stop.end(task.from).position - task.goal).abs() <= 1e-9;
            assert!(
                late_s <= 1e-9 * end_s || stops_there,
                "{late_s} of {end_s}: {task:?}"
            );
            if task.from.velocity.abs() <= task.limits.velocity {
                continue;
            }
            slowed += 1;
            // Alone it reverses only if it cannot stop before its goal.
            let reverses = |way: &Phases| {
                let towards = |state: AxisState| state.velocity * task.from.velocity.signum();
                way.extrema(task.from).map(towards).fold(0.0, f64::min) < -1e-9
            };
            assert!(
                reverses(&plan(&task.from, task.goal, &task.limits)) || !reverses(way),
                "{task:?} {way:?}"
            );
        }
    }
    assert!(slowed > 10_000, "{slowed}");
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
