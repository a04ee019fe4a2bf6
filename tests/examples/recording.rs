//! Measures a recording of a cell with two simulated arms and twenty monitors at the full rate: size, processor time and
//! memory of the recorder, what it lost, and the cycles with and without it, in turns. Usage:
//! `cargo run --release -p rcc-tests --example recording -- --seconds 3600`.

use std::fs;
use std::process::{Child, Stdio};
use std::time::Duration;

use clap::Parser;
use nix::sys::signal::Signal;
use rcc_tests::cycle_times::{CycleTimes, pinned, watched_net};
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{TestCell, await_some, repository};
use serde_json::Value;

/// Measures a recording of two arms.
#[derive(Parser)]
struct Arguments {
    /// Duration of each part, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Duration of each part without a recording, s; by default as long as one with a recording.
    #[arg(long)]
    alone: Option<f64>,
    /// Number of parts with, and as many without a recording.
    #[arg(long, default_value_t = 1)]
    rounds: u32,
}

fn recorder(cell: &TestCell, round: u32) -> Child {
    let mut recorder = cell.program("rcc-monitor");
    // An hour is larger than the default.
    recorder.args(["record", "--output", "json", "--max-size", "100GB"]);
    recorder.arg(std::env::temp_dir().join(file_name(round)));
    recorder.stdout(Stdio::piped());
    ends_with_test(&mut recorder)
        .spawn()
        .expect("rcc-monitor runs")
}

fn file_name(round: u32) -> String {
    format!("rcc-recording-{}-{round}.mcap", std::process::id())
}

/// Returns the processor time of a process, s, and its greatest memory, MB.
fn usage(pid: u32) -> (f64, f64) {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let fields: Vec<&str> = stat
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .collect();
    let ticks = |index: usize| {
        fields
            .get(index)
            .and_then(|field| field.parse::<f64>().ok())
    };
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak = peak.and_then(|line| {
        line.trim()
            .trim_end_matches(" kB")
            .trim()
            .parse::<f64>()
            .ok()
    });
    let seconds = (ticks(11).unwrap_or(0.0) + ticks(12).unwrap_or(0.0)) / 100.0;
    (seconds, peak.unwrap_or(0.0) / 1024.0)
}

/// Records for `duration`; returns the cycles meanwhile, and a line about the recorder.
fn recorded(cell: &TestCell, round: u32, duration: Duration) -> (CycleTimes, String) {
    let recorder = recorder(cell, round);
    let path = std::env::temp_dir().join(file_name(round));
    await_some("the file", || path.exists().then_some(()));
    let (cpu_before, _) = usage(recorder.id());
    let times = CycleTimes::during(cell, || std::thread::sleep(duration));
    let (cpu_s, peak_mb) = usage(recorder.id());
    signal(recorder.id(), Signal::SIGINT);
    let ended = recorder.wait_with_output().expect("it ends");
    let report: Value = serde_json::from_slice(&ended.stdout).expect("a report");
    fs::remove_file(path).expect("our file");
    assert_eq!(report["end"], "signal", "it recorded to the end: {report}");
    let number = |name: &str| report[name].as_f64().unwrap_or(0.0);
    let megabytes = number("bytes") * 1e-6;
    let line = format!(
        "recorder: {megabytes:.1} MB in {:.1} s, {:.0} MB an hour, {:.1} % of a core, at most {peak_mb:.0} MB of memory; lost {}, \
         missed {}, incomplete {}",
        number("span_s"),
        megabytes / number("span_s").max(1e-9) * 3600.0,
        (cpu_s - cpu_before) / duration.as_secs_f64() * 100.0,
        report["lost"],
        report["missed"],
        report["incomplete"],
    );
    (times, line)
}

fn main() {
    rcc_tests::cell::without_time_limit();
    let Arguments {
        seconds,
        alone,
        rounds,
    } = Arguments::parse();
    let config = repository().join("configs/cells/two-arms.yaml");
    let cell = TestCell::start(&config, pinned);
    let watched = cell.run(&watched_net());
    let duration = Duration::from_secs_f64(seconds);
    let duration_alone = Duration::from_secs_f64(alone.unwrap_or(seconds));
    let (mut alone, mut beside) = (CycleTimes::default(), CycleTimes::default());
    println!("{}", CycleTimes::HEADING);
    for round in 0..rounds {
        let part = CycleTimes::during(&cell, || std::thread::sleep(duration_alone));
        println!("{}", part.row("alone"));
        alone.add(&part);
        let (part, line) = recorded(&cell, round, duration);
        println!("{}\n{line}", part.row("recorded"));
        beside.add(&part);
    }
    println!("{}", alone.row("all alone"));
    println!("{}", beside.row("all recorded"));
    println!("{}", beside.compared(&alone));
    cell.done(watched, "cancel");
    cell.assert_ends(watched, "canceled");
    cell.stop();
}
