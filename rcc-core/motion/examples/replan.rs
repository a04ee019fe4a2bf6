//! What it costs to plan the way of seven joints anew, from any state to any goal: p50, p99 and the worst case of many, on
//! one thread. `cargo run --release -p rcc-motion --example replan`

use std::hint::black_box;
use std::time::Instant;

use rcc_core::axis::{AXIS_WORDS, AxisState, Follower};
use rcc_core::path::Limits;
use rcc_motion::goal::plan;

const ROUNDS: usize = 200_000;
const DT_S: f64 = 1e-3;

/// In -1 to 1: a linear congruential generator (Knuth, TAOCP 2, 3.3.4, table 1, line 26).
fn random(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

fn report(what: &str, mut times_ns: Vec<u64>) {
    times_ns.sort_unstable();
    let at = |share: f64| times_ns[((times_ns.len() - 1) as f64 * share) as usize];
    println!(
        "{what:<44} p50 {:>6} ns  p99 {:>6} ns  p99.9 {:>6} ns  max {:>8} ns",
        at(0.5),
        at(0.99),
        at(0.999),
        at(1.0)
    );
}

fn timed(work: impl FnOnce()) -> u64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_nanos() as u64
}

fn main() {
    let mut seed = 7;
    let mut random = || random(&mut seed);
    // LWR 4+: 110 to 204 deg/s, 1200 to 4400 deg/s², ten times that per s³.
    let limits = [1.92, 1.92, 2.23, 2.23, 3.56, 3.21, 3.21].map(|velocity: f64| Limits {
        velocity,
        acceleration: 11.0 * velocity,
        jerk: 110.0 * velocity,
    });
    let mut state = |limits: &Limits| AxisState {
        position: random(),
        velocity: 0.8 * limits.velocity * random(),
        acceleration: 0.8 * limits.acceleration * random(),
    };
    let mut all = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let tasks = limits.map(|limits| (state(&limits), state(&limits).position, limits));
        all.push(timed(|| {
            for (from, goal, limits) in &tasks {
                black_box(plan(black_box(from), *goal, limits));
            }
        }));
    }
    report("plan 7 joints, random states and goals", all);

    let mut joints = limits.map(|_| Follower::at_rest(0.0));
    let mut words = joints.map(|joint| joint.words());
    let (mut same, mut other) = (Vec::new(), Vec::new());
    let mut goals = [0.5; 7];
    for cycle in 0..ROUNDS {
        let new = cycle % 20 == 0;
        if new {
            goals = goals.map(|_| state(&limits[0]).position);
        }
        let step = |words: &mut [[f64; AXIS_WORDS]; 7], joints: &mut [Follower; 7]| {
            for (((words, joint), goal), limits) in
                words.iter_mut().zip(joints).zip(goals).zip(&limits)
            {
                *joint = Follower::from_words(words);
                black_box(joint.step(Some(goal), limits, DT_S, plan));
                *words = joint.words();
            }
        };
        let ns = timed(|| step(&mut words, &mut joints));
        if new { &mut other } else { &mut same }.push(ns);
    }
    report("cycle of 7 joints, goals as they were", same);
    report("cycle of 7 joints, all goals new", other);
}
