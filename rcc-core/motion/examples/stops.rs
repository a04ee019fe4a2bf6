//! Lists the durations of random time-optimal motions with `stops: keep` and `stops: give`, s, and the processor times to
//! plan them, ms: `cargo run --release -p rcc-motion --example stops -- 100 [KIND]` for the first 100 motions of each kind
//! and robot that can be built.

#[path = "../tests/motions/mod.rs"]
mod motions;

use motions::sampled::kept_and_given;
use motions::{COMPARED, robots};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let count = arguments.next().and_then(|count| count.parse().ok());
    let only = arguments.next();
    println!("kind,robot,seed,keep_s,give_s,keep_ms,give_ms");
    for kind in COMPARED {
        let name = format!("{kind:?}");
        if only.as_ref().is_some_and(|only| *only != name) {
            continue;
        }
        for robot in &robots() {
            let built = (0..).filter_map(|seed| Some((seed, kept_and_given(kind, robot, seed)?)));
            for (seed, [[keep_s, give_s], planning_s]) in built.take(count.unwrap_or(100)) {
                let [keep_ms, give_ms] = planning_s.map(|planning_s| 1e3 * planning_s);
                println!(
                    "{name},{},{seed},{keep_s:.17},{give_s:.17},{keep_ms:.3},{give_ms:.3}",
                    robot.name
                );
            }
        }
    }
}
