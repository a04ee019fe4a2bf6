//! Measures a recording of a cell with two simulated arms and twenty monitors at the full rate: size, processor time and memory of the recorder,
//! what it lost, and late cycles with and without it, in turns. Usage:
//! `cargo run --release -p rcc-tests --example recording -- --seconds 600`.

use std::fs;
use std::process::{Child, Stdio};
use std::time::Duration;

use clap::Parser;
use nix::sys::signal::Signal;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{TestCell, await_some, repository};
use serde_json::Value;

/// Measures a recording of two arms.
#[derive(Parser)]
struct Arguments {
    /// Duration of each part, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Number of parts with, and as many without a recording.
    #[arg(long, default_value_t = 1)]
    rounds: u32,
}

/// Twenty monitors at 1 kHz.
fn net() -> String {
    let mut text = String::from(
        "net: watched\nprimitives:\n  cancel: {type: Cancel}\n  clock: {type: Time}\n  end: {type: Termination, inputs: \
         {done: cancel.requested}}\n",
    );
    let mut monitor = |name: &str, port: &str| {
        text.push_str(&format!(
            "  see_{name}: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: {port}}}}}\n"
        ));
    };
    for number in 0..20 {
        monitor(&format!("n{number}"), "clock.out");
    }
    text
}

fn recorder(cell: &TestCell, round: u32) -> Child {
    let mut recorder = cell.program("rcc-monitor");
    recorder.args(["record", "--output", "json"]);
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

fn main() {
    rcc_tests::cell::without_time_limit();
    let Arguments { seconds, rounds } = Arguments::parse();
    let config = repository().join("configs/cells/two-arms.yaml");
    let cell = TestCell::start(&config, |text| text);
    let watched = cell.run(&net());
    let boards = cell.watch();
    let duration = Duration::from_secs_f64(seconds);
    let counts = || {
        let status = boards.status();
        (status.cycle, status.late)
    };
    println!("part, cycles, late, MB, MB/h, recorder CPU %, recorder MB, lost, missed, incomplete");
    for round in 0..rounds {
        let (cycle, late) = counts();
        std::thread::sleep(duration);
        let now = counts();
        println!("alone, {}, {}", now.0 - cycle, now.1 - late);

        let recorder = recorder(&cell, round);
        let path = std::env::temp_dir().join(file_name(round));
        await_some("the file", || path.exists().then_some(()));
        let (cycle, late) = counts();
        std::thread::sleep(duration);
        let now = counts();
        let (cpu_s, peak_mb) = usage(recorder.id());
        signal(recorder.id(), Signal::SIGINT);
        let ended = recorder.wait_with_output().expect("it ends");
        let report: Value = serde_json::from_slice(&ended.stdout).expect("a report");
        let megabytes = report["bytes"].as_f64().unwrap_or(0.0) * 1e-6;
        println!(
            "recorded, {}, {}, {megabytes:.1}, {:.0}, {:.1}, {peak_mb:.0}, {}, {}, {}",
            now.0 - cycle,
            now.1 - late,
            megabytes / seconds * 3600.0,
            cpu_s / seconds * 100.0,
            report["lost"],
            report["missed"],
            report["incomplete"],
        );
        fs::remove_file(path).expect("our file");
    }
    cell.done(watched, "cancel");
    cell.assert_ends(watched, "canceled");
    // Its files are the cell's, which must leave nothing.
    drop(boards);
    cell.stop();
}
