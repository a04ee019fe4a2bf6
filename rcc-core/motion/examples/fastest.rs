//! Compares the duration of time-optimal motions with those of constant acceleration limit, and the cost of building
//! them: `cargo run --release -p rcc-motion --example fastest -- 200`. One thread; ratios carry over to other machines.

#[path = "../tests/motions/mod.rs"]
mod motions;

use motions::{COMPARED, compared, robots};

fn main() {
    let count = std::env::args().nth(1).and_then(|count| count.parse().ok());
    println!(
        "kind       robot        motions  time-optimal/uniform: median     p10     p90   build time, ms: uniform fastest"
    );
    for kind in COMPARED {
        for robot in &robots() {
            let mut ratios = Vec::new();
            let mut built_s = [0.0; 2];
            for seed in 0..count.unwrap_or(200) {
                if let Some((times_s, build_s)) = compared(kind, robot, seed) {
                    ratios.push(times_s[1] / times_s[0]);
                    for (sum, time) in built_s.iter_mut().zip(build_s) {
                        *sum += time;
                    }
                }
            }
            ratios.sort_by(f64::total_cmp);
            let at = |part: f64| ratios.get((part * ratios.len() as f64) as usize).copied();
            let [median, low, high] = [0.5, 0.1, 0.9].map(|part| at(part).unwrap_or(f64::NAN));
            let [uniform_ms, fastest_ms] = built_s.map(|sum| 1e3 * sum / ratios.len() as f64);
            let kind = format!("{kind:?}");
            println!(
                "{kind:10} {:12} {:7} {median:29.3} {low:7.3} {high:7.3} {uniform_ms:19.2} {fastest_ms:7.2}",
                robot.name,
                ratios.len()
            );
        }
    }
}
