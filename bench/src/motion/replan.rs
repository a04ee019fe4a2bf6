//! Measures the cost of replanning the motion of seven joints from any state to any goal: not as a mean, but as the
//! distribution over many cases. See the parent module.

use std::hint::black_box;
use std::time::Instant;

use rcc_core::axis::{AXIS_WORDS, AxisFollower, AxisState, AxisTask, Phases};
use rcc_core::path::{MotionLimits, Motions};
use rcc_motion::MotionSetBuilder;
use rcc_motion::goal::plan;
use rcc_testing::{Random, Rng, quantile};

const PERIOD_S: f64 = 1e-3;

/// Distribution of the durations of many cases.
pub struct TimeQuantiles {
    /// Name of the measured case.
    pub name: &'static str,
    /// The durations that 50, 99, 99.9 and 100 % of the cases did not exceed, ns.
    pub ns: [u64; 4],
}

fn spread(name: &'static str, mut times_ns: Vec<u64>) -> TimeQuantiles {
    times_ns.sort_unstable();
    let at = |share: f64| quantile(&times_ns, share).unwrap_or(0);
    TimeQuantiles {
        name,
        ns: [0.5, 0.99, 0.999, 1.0].map(at),
    }
}

fn timed(work: impl FnOnce()) -> u64 {
    let begun = Instant::now();
    work();
    begun.elapsed().as_nanos() as u64
}

/// Returns the limits of an LWR 4+: 110 to 204 deg/s, 1200 to 4400 deg/s², and ten times that per s³.
fn limits() -> [MotionLimits; 7] {
    [1.92, 1.92, 2.23, 2.23, 3.56, 3.21, 3.21].map(|velocity: f64| MotionLimits {
        velocity,
        acceleration: 11.0 * velocity,
        jerk: 110.0 * velocity,
    })
}

fn state(random: &mut Rng, limits: &MotionLimits) -> AxisState {
    AxisState {
        position: random.uniform(-1.0, 1.0),
        velocity: 0.8 * limits.velocity * random.uniform(-1.0, 1.0),
        acceleration: 0.8 * limits.acceleration * random.uniform(-1.0, 1.0),
    }
}

/// Runs all measurements with this number of random cases; 200,000 take seconds.
#[must_use]
pub fn measure(cases: usize) -> Vec<TimeQuantiles> {
    let (mut random, limits) = (Rng::with_seed(7), limits());
    let motions = MotionSetBuilder::new(&[], &[], PERIOD_S, 0).finish();
    let mut motions = motions.expect("a set without motions");
    let (mut alone, mut together) = (Vec::with_capacity(cases), Vec::with_capacity(cases));
    for _ in 0..cases {
        let tasks = limits.map(|limits| AxisTask {
            from: state(&mut random, &limits),
            goal: random.uniform(-1.0, 1.0),
            limits,
        });
        alone.push(timed(|| {
            for AxisTask { from, goal, limits } in &tasks {
                black_box(plan(black_box(from), *goal, limits));
            }
        }));
        let mut ways = [Phases::default(); 7];
        together.push(timed(|| motions.plan_axes(black_box(&tasks), &mut ways)));
        black_box(ways);
    }
    let (same, new) = follow(&mut random, &limits, cases);
    vec![
        spread("planning alone, random states and goals", alone),
        spread("the same, so that all arrive together", together),
        spread("a cycle on the way to goals as they were", same),
        spread("a cycle with seven new goals", new),
    ]
}

/// Measures cycles of seven joints with new goals every 20 cycles; returns the durations of cycles without and with new
/// goals, ns.
fn follow(random: &mut Rng, limits: &[MotionLimits; 7], cases: usize) -> (Vec<u64>, Vec<u64>) {
    let mut joints = limits.map(|_| AxisFollower::at_rest(0.0));
    let mut words = joints.map(|joint| joint.words());
    let (mut same, mut other) = (Vec::new(), Vec::new());
    let mut goals = [0.5; 7];
    for cycle in 0..cases {
        let new = cycle % 20 == 0;
        if new {
            goals = goals.map(|_| random.uniform(-1.0, 1.0));
        }
        let step = |words: &mut [[f64; AXIS_WORDS]; 7], joints: &mut [AxisFollower; 7]| {
            for (((words, joint), goal), limits) in
                words.iter_mut().zip(joints).zip(goals).zip(limits)
            {
                *joint = AxisFollower::from_words(words);
                black_box(joint.step(Some(goal), limits, PERIOD_S, plan));
                *words = joint.words();
            }
        };
        let ns = timed(|| step(&mut words, &mut joints));
        if new { &mut other } else { &mut same }.push(ns);
    }
    (same, other)
}
