//! Compares the durations of time-optimal motions, of the default ones and of those with one acceleration for the whole
//! path, and the cost of building them: `cargo run --release -p rcc-motion --example fastest -- 200`. One thread; ratios carry over to other machines.

#[path = "../tests/motions/mod.rs"]
mod motions;

use motions::{COMPARED, compared, robots};
use rcc_testing::quantile;

fn main() {
    let count = std::env::args().nth(1).and_then(|count| count.parse().ok());
    println!(
        "                                     of time-optimal, uniform         default  build time, ms\n\
         kind       robot        motions  median     p90    most  median     p90    most  uniform default optimal"
    );
    for kind in COMPARED {
        for robot in &robots() {
            let mut ratios = [const { Vec::new() }; 2];
            let mut built_s = [0.0; 3];
            for seed in 0..count.unwrap_or(200) {
                if let Some((times_s, build_s)) = compared(kind, robot, seed) {
                    for (ratios, time_s) in ratios.iter_mut().zip(times_s) {
                        ratios.push(time_s / times_s[2]);
                    }
                    for (sum, time) in built_s.iter_mut().zip(build_s) {
                        *sum += time;
                    }
                }
            }
            let motions = ratios[0].len();
            print!("{:10} {:12} {motions:7}", format!("{kind:?}"), robot.name);
            for mut ratios in ratios {
                ratios.sort_by(f64::total_cmp);
                for share in [0.5, 0.9, 1.0] {
                    print!(" {:7.3}", quantile(&ratios, share).unwrap_or(f64::NAN));
                }
            }
            for sum in built_s {
                print!(" {:7.2}", 1e3 * sum / motions as f64);
            }
            println!();
        }
    }
}
