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

/// Columns of a table: title, and key in the file.
type Columns = [(&'static str, &'static str)];

const COLUMNS: &Columns = &[
    ("default", "default"),
    ("fastest", "fastest"),
    ("default of fastest", "default_of_keep"),
    ("fastest, jerk × 100", "loose_fastest"),
    ("fastest known time law", "reference"),
    ("fastest, relative to it", "of_reference"),
    ("default, relative to it", "default_of_reference"),
];

const RESERVES: &Columns = &[
    ("duration, give", "give_of_keep"),
    ("fastest known, keep", "of_reference"),
    ("fastest known, give", "give_of_reference"),
    ("stop, default", "stops_default"),
    ("stop, keep", "stops_keep"),
    ("stop, give", "stops_give"),
    ("pause, default", "pauses_default"),
    ("pause, keep", "pauses_keep"),
    ("pause, give", "pauses_give"),
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
    let ours = ["default", "fastest", "give", "loose_fastest"];
    let least = ours.into_iter().flat_map(of);
    let least = least.fold(f64::INFINITY, |least, it| least.min(it.least));
    let halved = of("halved").fold(0.0_f64, |most, it| most.max(it.worst));
    let sum = |count: fn(&ToppRow) -> usize| groups.iter().map(count).sum::<usize>();
    let text = format!(
        "{head}How many times as long motions take as those of an independent TOPP-RA (toppra {}) along the same paths of joints, \
         from rest to rest: median (90 %, worst) of random motions (`rcc-core/motion/tests/motions`). These are \
         durations of motions, independent of the machine that computes them. toppra respects the limits of velocity \
         and acceleration of the joints, has no jerk limit, and reserves nothing for a stop or a pause: a lower bound \
         that no motion with a jerk limit reaches. The jerk limits are ten \
         times the acceleration limits, so that an acceleration builds up in 0.1 s: long for motions of half a second. Where it \
         builds up in 1 ms (jerk × 100), the remaining difference is mostly the reserve of our motions for stops. The \
         fastest known time law, available for some of the motions, respects the same limits of velocity, acceleration \
         and jerk, but reserves nothing for a stop either; a sequence of linear programs finds it within seconds, \
         starting from ours and from TOPP-RA's, or it is ours with `stops: give`: not a bound, but an existing time law. \
         The last columns are the durations \
         of our motions relative to that time law. *Fastest* is `time_optimal: true`; *default* is without it and without a \
         given velocity.\n\n",
        first.version
    );
    let reserves = format!(
        "\n## What a reserve for stops costs\n\n\
         `stops: give` of a time-optimal motion reserves 2 % of the limits of acceleration and jerk instead of 15 %; the default \
         reserves 30 %, or has one acceleration for the whole path, where a time law would save little. \
         *Duration, give* is relative to the same motion with `stops: keep`, *fastest known* relative to the fastest known \
         time law. *Stop* and *pause* are the seconds until the arm rests, begun at eight times of each motion, which \
         are evenly distributed over it. Median (90 %, worst). Whether every limit is kept with either of them, under random \
         overrides, pauses and stops, is what `rcc-core/motion/tests/random_motions.rs` judges.\n\n{}",
        rows(RESERVES, &groups)
    );
    Ok(format!(
        "{text}{}\nOf {} motions none is faster than the bound: the least takes {least:.3} of it. Halving the number \
         of grid points changes TOPP-RA's time by {:.2} % at most; it solved {}. The fastest known time law is available for {}.\n{reserves}",
        rows(COLUMNS, &groups),
        sum(|it| it.motions),
        100.0 * halved,
        match sum(|it| it.failed) {
            0 => "all paths".to_owned(),
            failed => format!("all paths but {failed}, which are left out"),
        },
        sum(|it| it.references),
    ))
}

/// The table with these columns: one row for each kind and robot.
fn rows(columns: &Columns, groups: &[ToppRow]) -> String {
    let mut heads = vec!["path, robot", "motions"];
    heads.extend(columns.iter().map(|(head, _)| head));
    let rows: Vec<_> = groups.iter().map(|group| row(columns, group)).collect();
    table(&heads, &rows)
}

fn row(columns: &Columns, group: &ToppRow) -> Vec<String> {
    let cells = columns.iter().map(|(_, key)| match group.times.get(*key) {
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
