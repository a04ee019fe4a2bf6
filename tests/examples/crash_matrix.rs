//! `crash_matrix`: kills or hangs each process of a cell in each phase and each way, and writes a table of the results.
//! Runs on the main thread; see `rcc_tests::matrix`.

use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::Instant;

use clap::Parser;
use rcc_tests::matrix::{Outcome, cases, run, table};

/// Kills or hangs each process of a cell in each phase and each way.
#[derive(Debug, Parser)]
struct Arguments {
    /// Write the table to this file instead of the terminal
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Run only the cases whose description contains all of these words, such as `Executor` or `Moving Kill`
    #[arg(long, default_value = "")]
    only: String,
    /// Seed of the random moments
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    rcc_tests::cell::without_time_limit();
    let wanted = |text: &str| {
        arguments
            .only
            .split_whitespace()
            .all(|word| text.contains(word))
    };
    let mut chosen = cases();
    chosen.retain(|case| wanted(&format!("{case:?}")));
    let (begun, count) = (Instant::now(), chosen.len());
    let mut number = 0;
    let outcomes = run(&chosen, arguments.seed, |case, outcome| {
        number += 1;
        let at = begun.elapsed().as_secs_f64();
        eprintln!("{at:7.1} s  {number}/{count}  {case:?}: {outcome:?}");
    });
    let text = table(&outcomes, &machine(begun.elapsed().as_secs()));
    match &arguments.write {
        None => println!("{text}"),
        Some(path) => {
            if let Err(error) = std::fs::write(path, text) {
                eprintln!("{}: {error}", path.display());
                return ExitCode::FAILURE;
            }
        }
    }
    let broken = outcomes
        .iter()
        .any(|(_, outcome)| matches!(outcome, Outcome::Broken(_)));
    ExitCode::from(u8::from(broken))
}

/// Returns a sentence with the date, the machine and the duration.
fn machine(seconds: u64) -> String {
    let date = Command::new("date").arg("+%F").output();
    let date = date.map_or(String::new(), |output| {
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    });
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let version: String = kernel
        .chars()
        .take_while(|c| c.is_ascii_digit() || *c == '.')
        .collect();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let kind = if cpu.contains(" hypervisor") {
        "a virtual machine"
    } else {
        "a machine"
    };
    let minutes = seconds as f64 / 60.0;
    let real_time =
        std::fs::read_to_string("/sys/kernel/realtime").is_ok_and(|text| text.trim() == "1");
    let kernel = if real_time {
        "with PREEMPT_RT"
    } else {
        "without PREEMPT_RT"
    };
    format!(
        "Last run: {date}, {minutes:.0} minutes on {kind} with {cores} cores, {}, Linux {version} {kernel}.",
        std::env::consts::ARCH
    )
}
