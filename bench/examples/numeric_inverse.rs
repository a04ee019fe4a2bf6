//! Measures the numeric inverse kinematics of `SerialArm`: `numeric_inverse [POSES]` prints how many of so many random
//! poses (10,000 by default) are found from hints at three distances, the steps, and ns per call.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use rcc_core::kinematics::{RESIDUAL_MAX, SerialArm};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_testing::{Random, Rng, arms};

const POSES: usize = 10_000;
const SEED: u64 = 1;

/// Distances of the hint, largest difference of each joint in rad: a cycle of 1 ms at about 2 rad/s, a gap in a stream of
/// poses, and anywhere.
const DISTANCES_RAD: [f64; 3] = [0.002, 0.2, f64::INFINITY];

/// The measurements at one distance, sorted.
struct Measured {
    found: usize,
    ns: Vec<u64>,
    steps: Vec<u32>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let poses = match std::env::args().nth(1) {
        Some(number) => number.parse()?,
        None => POSES,
    };
    println!("seed {SEED}, {poses} poses for each row");
    println!("| arm | hint within | solved | steps p50, p99, max | ns p50, p99, max |");
    println!("|---|---|---|---|---|");
    let six = [[-std::f64::consts::PI, std::f64::consts::PI]; 6];
    for (name, arm, ranges) in [
        ("UR5e", arms::ur5e(), &six[..]),
        ("UR10e", arms::ur10e(), &six[..]),
        ("Panda", arms::panda(), &arms::PANDA_JOINTS[..]),
    ] {
        for distance_rad in DISTANCES_RAD {
            let measured = measure(&arm, ranges, distance_rad, poses);
            println!("{}", row(name, distance_rad, &measured));
        }
    }
    Ok(())
}

fn measure(arm: &SerialArm, ranges: &[[f64; 2]], distance_rad: f64, poses: usize) -> Measured {
    let mut random = Rng::with_seed(SEED);
    let mut measured = Measured {
        found: 0,
        ns: Vec::with_capacity(poses),
        steps: Vec::with_capacity(poses),
    };
    for _ in 0..poses {
        let joints = anywhere(ranges, &mut random);
        let mut hint = anywhere(ranges, &mut random);
        if distance_rad.is_finite() {
            hint = joints;
            for joint in hint.iter_mut().take(ranges.len()) {
                *joint += random.uniform(-distance_rad, distance_rad);
            }
        }
        let pose = arm.forward(&joints);
        let angle = arm.arm_angle(&joints).unwrap_or(0.0);
        let begun = Instant::now();
        let solution = black_box(arm.solve(black_box(&pose), angle, black_box(&hint)));
        let ns = begun.elapsed().as_nanos();
        let Ok(solution) = solution else { continue };
        measured.found += usize::from(solution.residual <= RESIDUAL_MAX);
        measured.ns.push(u64::try_from(ns).unwrap_or(u64::MAX));
        measured.steps.push(solution.steps);
    }
    measured.ns.sort_unstable();
    measured.steps.sort_unstable();
    measured
}

fn anywhere(ranges: &[[f64; 2]], random: &mut Rng) -> Joints {
    let mut joints = [0.0; JOINTS_MAX];
    for (joint, [lower, upper]) in joints.iter_mut().zip(ranges) {
        *joint = random.uniform(*lower, *upper);
    }
    joints
}

fn row(name: &str, distance_rad: f64, measured: &Measured) -> String {
    let hint = match distance_rad.is_finite() {
        true => format!("{distance_rad} rad"),
        false => "the whole range".to_owned(),
    };
    let [steps, ns] = [
        percentiles(
            &measured
                .steps
                .iter()
                .map(|steps| u64::from(*steps))
                .collect::<Vec<_>>(),
        ),
        percentiles(&measured.ns),
    ];
    let share = 100.0 * measured.found as f64 / measured.ns.len().max(1) as f64;
    format!("| {name} | {hint} | {share:.2} % | {steps} | {ns} |")
}

/// The median, the 99th percentile and the greatest of sorted values.
fn percentiles(sorted: &[u64]) -> String {
    let at = |share: f64| {
        let place = (sorted.len().saturating_sub(1) as f64 * share) as usize;
        sorted.get(place).copied().unwrap_or(0)
    };
    format!("{}, {}, {}", at(0.5), at(0.99), at(1.0))
}
