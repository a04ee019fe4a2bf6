//! Measures how long motions along paths are planned.

use rcc_bench::measure::Effort;
use rcc_core::path::{SpeedProfile, StopReserve};
use rcc_testing::quantile;

use crate::table::{digits, table, verdict};

#[path = "../../../rcc-core/motion/tests/motions/mod.rs"]
mod motions;

use motions::sampled::planned;
use motions::{MotionKind, robots};

/// Number of motions of each kind and robot.
const MOTIONS: usize = 40;
/// The same for a single round, which only tries the program.
const MOTIONS_SHORT: usize = 1;

/// Durations of the motions that are listed, s: about one second.
const ABOUT_A_SECOND: std::ops::Range<f64> = 0.7..1.4;

const KINDS: [(MotionKind, &str); 4] = [
    (MotionKind::Line, "line"),
    (MotionKind::Circle, "circle"),
    (MotionKind::Spline, "spline"),
    (MotionKind::Sequence, "sequence"),
];

/// Profiles, and the goal for a motion of a second, ms.
const PROFILES: [(SpeedProfile, &str, f64); 3] = [
    (SpeedProfile::Adaptive, "default", 20.0),
    (
        SpeedProfile::TimeOptimal(StopReserve::Keep),
        "`stops: keep`",
        100.0,
    ),
    (
        SpeedProfile::TimeOptimal(StopReserve::Give),
        "`stops: give`",
        100.0,
    ),
];

/// The section of the page.
pub fn section(effort: Effort) -> String {
    eprintln!("motion: planning");
    let count = match effort.rounds {
        0..=1 => MOTIONS_SHORT,
        _ => MOTIONS,
    };
    let rows = KINDS.iter().flat_map(|(kind, name)| {
        PROFILES.iter().map(move |(pace, profile, goal)| {
            let mut times = planning_ms(*kind, *pace, count);
            times.sort_by(f64::total_cmp);
            let at = |share: f64| quantile(&times, share).map_or("–".to_owned(), digits);
            vec![
                format!("{name}, {profile}"),
                times.len().to_string(),
                at(0.5),
                at(0.9),
                at(1.0),
                quantile(&times, 0.5).map_or(String::new(), |median| verdict(median, *goal)),
            ]
        })
    });
    format!(
        "## Planning\n\n\
         Processor time, ms, to plan random motions of {} to {} s of five robots, which happens when a net is loaded; \
         `rcc-cli explain` tells it for a net. Goals are compared with the median.\n\n{}",
        ABOUT_A_SECOND.start,
        ABOUT_A_SECOND.end,
        table(
            &["motion", "motions", "50 %", "90 %", "all", "goal"],
            &rows.collect::<Vec<_>>()
        )
    )
}

/// The times to plan the motions of a kind that take about a second, ms, of the first `count` seeds of each robot that
/// can be built.
fn planning_ms(kind: MotionKind, pace: SpeedProfile, count: usize) -> Vec<f64> {
    let robots = robots();
    let motions = robots.iter().flat_map(|robot| {
        (0..)
            .filter_map(move |seed| planned(kind, robot, seed, pace))
            .take(count)
    });
    let listed = motions.filter(|[_, duration_s]| ABOUT_A_SECOND.contains(duration_s));
    listed.map(|[planning_s, _]| planning_s * 1e3).collect()
}
