//! Prints the joint paths of random motions and our motions along them: `topp COUNT` prints a line of JSON for each of
//! the first COUNT motions of each kind and robot (those of `rcc-core/motion/tests/motions`) that can be built. Used by
//! `bench/topp/compare`, which computes motions along the same paths with another program.

use std::error::Error;
use std::io::Write;

use serde_json::{Value, json};

#[path = "../../rcc-core/motion/tests/motions/mod.rs"]
mod motions;

use motions::sampled::{PathSample, Sampled, sampled};
use motions::{COMPARED, robots};

/// Factor of a jerk limit so high that it hardly matters.
const JERK: f64 = 100.0;

fn main() -> Result<(), Box<dyn Error>> {
    let count = std::env::args().nth(1).ok_or("usage: topp COUNT")?;
    let count: usize = count.parse()?;
    let mut out = std::io::stdout().lock();
    for kind in COMPARED {
        for robot in &robots() {
            let built = (0..).filter_map(|seed| Some((seed, sampled(kind, robot, seed, JERK)?)));
            for (seed, motion) in built.take(count) {
                let mut line = line(&motion);
                line["kind"] = json!(format!("{kind:?}"));
                line["robot"] = json!(robot.name);
                line["seed"] = json!(seed);
                writeln!(out, "{line}")?;
            }
        }
    }
    Ok(())
}

fn line(motion: &Sampled) -> Value {
    let joints = |part: &[PathSample]| {
        let joints = part.iter().map(|(_, q)| q[..motion.joints].to_vec());
        joints.collect::<Vec<_>>()
    };
    let s = |part: &[PathSample]| part.iter().map(|(s, _)| *s).collect::<Vec<_>>();
    let parts = motion.path.iter().zip(&motion.fastest);
    let parts = parts.map(|(path, run)| {
        // The time-scaled motion has no path parameter; only its joints tell where on the path it is.
        json!({"s": s(path), "q": joints(path), "fastest_q": joints(run)})
    });
    let [velocity, acceleration, jerk] = motion.limits.map(|row| row[..motion.joints].to_vec());
    json!({
        "velocity": velocity,
        "acceleration": acceleration,
        "jerk": jerk,
        "default_s": motion.times_s[0],
        "fastest_s": motion.times_s[1],
        "give_s": motion.times_s[2],
        "stops_s": motion.halts_s.each_ref().map(|[stops, _]| stops),
        "pauses_s": motion.halts_s.each_ref().map(|[_, pauses]| pauses),
        "loose_fastest_s": motion.loose_s,
        "parts": parts.collect::<Vec<_>>(),
    })
}
