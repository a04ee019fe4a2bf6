//! Random motions of each kind, in any number: `cargo run --release -p rcc-motion --example random_motions -- 100000
//! [KIND [ROBOT]]`. One thread; COUNT is divided among three robots, so with a given ROBOT a third of it runs.

#[path = "../tests/motions/mod.rs"]
mod motions;

use rcc_core::path::SpeedProfile;

use motions::{Tally, case, kinds_and_paces, robots};

fn pace_name(pace: SpeedProfile) -> &'static str {
    match pace {
        SpeedProfile::Uniform => "uniform",
        SpeedProfile::Adaptive => "adaptive",
        SpeedProfile::TimeOptimal(_) => "optimal",
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let count: u64 = arguments
        .next()
        .and_then(|count| count.parse().ok())
        .unwrap_or(10_000);
    let (only, robot) = (arguments.next(), arguments.next());
    println!(
        "kind, profile          robot          motions  refused    cycles  off path  velocity  accel.    jerk  broken"
    );
    let mut all_kept = true;
    for (kind, pace) in kinds_and_paces() {
        let name = format!("{kind:?}, {}", pace_name(pace));
        if only
            .as_ref()
            .is_some_and(|only| *only != format!("{kind:?}"))
        {
            continue;
        }
        let robots = robots();
        for robot in (robots.iter()).filter(|of| robot.as_ref().is_none_or(|name| of.name == *name))
        {
            let mut tally = Tally::default();
            // Refused motions do not count.
            for seed in 0.. {
                let planned = tally.ran + tally.broken;
                if planned >= count.div_ceil(robots.len() as u64) || tally.refused > 20 * count {
                    break;
                }
                let fault = tally.count(case((kind, pace), robot, seed));
                if let Some(fault) = fault.filter(|_| tally.broken <= 5) {
                    println!("{name} of {}, seed {seed}: {fault}", robot.name);
                }
            }
            let Tally {
                refused,
                broken,
                worst,
                ..
            } = tally;
            let ran = tally.ran + broken;
            let [velocity, acceleration, jerk] = worst.parts.map(|part| 100.0 * part);
            println!(
                "{name:22} {:12} {ran:9} {refused:8} {:9} {:8.1e} m {velocity:6.2} % {acceleration:5.2} % {jerk:5.2} % {broken:6}",
                robot.name, worst.cycles, worst.off_m
            );
            all_kept &= broken == 0;
        }
    }
    if !all_kept {
        std::process::exit(1);
    }
}
