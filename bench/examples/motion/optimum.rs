//! Compares the duration of our motions with those of TOPP-RA along the same paths (`bench/topp/compare`).

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

use serde::Deserialize;

use crate::table::{digits, table};

/// A row of `bench/topp/compare --json`: motions of one kind and robot.
#[derive(Deserialize)]
struct ToppRow {
    kind: String,
    robot: String,
    /// Version of toppra.
    version: String,
    motions: usize,
    /// Number of paths that toppra did not solve.
    failed: usize,
    /// Number of motions with a reference that keeps limits of jerk.
    references: usize,
    times: BTreeMap<String, TimeRatios>,
}

#[derive(Deserialize)]
struct TimeRatios {
    least: f64,
    median: f64,
    /// 90th percentile.
    most: f64,
    worst: f64,
}

/// Columns of the page: title, and key in the file.
const COLUMNS: [(&str, &str); 5] = [
    ("even", "even"),
    ("fastest", "fastest"),
    ("fastest, jerk × 100", "loose_fastest"),
    ("soonest law known", "reference"),
    ("fastest, by that law", "of_reference"),
];

/// Returns the section of the page; see the module.
pub fn section(file: Option<&Path>) -> Result<String, Box<dyn Error>> {
    let head = "## Time-optimal motions and the optimum\n\n";
    let Some(file) = file else {
        return Ok(format!(
            "{head}Not compared here: run `bench/topp/compare --json FILE` where toppra is installed.\n"
        ));
    };
    let groups: Vec<ToppRow> = serde_json::from_str(&fs::read_to_string(file)?)?;
    let Some(first) = groups.first() else {
        return Err(format!("{} has no rows", file.display()).into());
    };
    let of = |key: &'static str| groups.iter().filter_map(move |group| group.times.get(key));
    let ours = ["even", "fastest", "loose_even", "loose_fastest"];
    let least = ours.into_iter().flat_map(of);
    let least = least.fold(f64::INFINITY, |least, it| least.min(it.least));
    let halved = of("halved").fold(0.0_f64, |most, it| most.max(it.worst));
    let sum = |count: fn(&ToppRow) -> usize| groups.iter().map(count).sum::<usize>();
    let text = format!(
        "{head}How many times as long motions take as those of an independent TOPP-RA (toppra {}) along the same paths of joints, \
         from rest to rest: median (90 %, worst) of random motions (`rcc-core/motion/tests/motions`). These are times of motions, no \
         matter what machine computes them. toppra keeps the limits of velocity and acceleration of the joints, knows no jerk and \
         keeps nothing for a stop or a pause: a lower bound, which nothing with a jerk limit reaches. The jerk limits are ten \
         times the acceleration limits, so that an acceleration builds up in 0.1 s: long for motions of half a second. Where it \
         builds up in 1 ms (jerk × 100), what is left is mostly what ours keep for stops. The soonest law known, of some of the \
         motions, keeps the same limits of velocity, acceleration and jerk, but nothing for a stop either; linear programs one \
         after the other find it within seconds, beginning with ours and with TOPP-RA's: no bound, but a law that there is. The \
         last column is how many times as long as that law ours take.\n\n",
        first.version
    );
    let mut heads = vec!["path, robot", "motions"];
    heads.extend(COLUMNS.map(|(head, _)| head));
    let rows: Vec<_> = groups.iter().map(row).collect();
    Ok(format!(
        "{text}{}\nOf {} motions none is sooner than the bound: the least takes {least:.3} of it. Half as many grid points change \
         TOPP-RA's time by {:.2} % at most; it solved {}. The soonest law is known of {}.\n",
        table(&heads, &rows),
        sum(|it| it.motions),
        100.0 * halved,
        match sum(|it| it.failed) {
            0 => "all paths".to_owned(),
            failed => format!("all paths but {failed}, which are left out"),
        },
        sum(|it| it.references),
    ))
}

fn row(group: &ToppRow) -> Vec<String> {
    let cells = COLUMNS.iter().map(|(_, key)| match group.times.get(*key) {
        Some(it) => format!(
            "{} ({}, {})",
            digits(it.median),
            digits(it.most),
            digits(it.worst)
        ),
        None => "–".to_owned(),
    });
    let names = [
        format!("{}, {}", group.kind, group.robot),
        group.motions.to_string(),
    ];
    names.into_iter().chain(cells).collect()
}
