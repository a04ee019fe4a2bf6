//! `rcc-monitor`: shows what the nets of a cell make visible. It only reads, and can do no harm.
//! One thread does it all.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::{self, BufWriter};
use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand};
use nix::sys::signal::Signal;
use rcc_ipc::pattern::Pattern;
use rcc_monitor::reader;
use rcc_monitor::signals::Signals;
use rcc_monitor::tail::{End, Format, Options, remark, tail};

/// Shows what the nets of a cell make visible.
#[derive(Parser)]
#[command(version = rcc_ipc::version::version())]
struct Arguments {
    /// Name of the cell.
    #[arg(long, env = "RCC_CELL", default_value = "demo", global = true)]
    cell: String,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Print values as they come.
    Tail {
        /// Ports like line/move.pose or line/ik.joints[2]; * and ? stand for any characters. All without.
        patterns: Vec<Pattern>,
        /// How values are printed.
        #[arg(long, value_enum, default_value = "human")]
        output: Format,
        /// End after this many records.
        #[arg(long)]
        count: Option<u64>,
        /// End after this time: 500ms, 2s, 1min.
        #[arg(long = "for", value_name = "DURATION", value_parser = duration)]
        duration: Option<Duration>,
    },
}

/// Exit code after Ctrl-C, as a shell has it.
const INTERRUPTED: u8 = 130;
/// Exit code when nobody reads any more: what a shell shows for a program that SIGPIPE ended.
const READER_GONE: u8 = 141;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // When memory runs out the kernel ends those first that only look; the score can always be raised, see proc(5).
    let _ = std::fs::write("/proc/self/oom_score_adj", "500");
    let Verb::Tail {
        patterns,
        output,
        count,
        duration,
    } = arguments.verb;
    let options = Options {
        patterns,
        format: output,
        count,
        duration,
    };
    let mut signals = match Signals::catch() {
        Ok(signals) => signals,
        Err(error) => {
            remark(&format!("error: signals cannot be caught: {error}"));
            return ExitCode::FAILURE;
        }
    };
    let mut out = BufWriter::new(io::stdout().lock());
    match tail(&arguments.cell, &options, &mut signals, &mut out, || {
        reader::is_gone(&io::stdout())
    }) {
        Ok(End::Signal(signal)) if signal == Signal::SIGINT as i32 => ExitCode::from(INTERRUPTED),
        Ok(End::ReaderGone) => ExitCode::from(READER_GONE),
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            remark(&format!("error: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let digits = text
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor = match unit.trim() {
        "ms" => 1e-3,
        "s" | "" => 1.0,
        "min" => 60.0,
        _ => return Err(format!("`{text}` is no time: write 500ms, 2s or 1min")),
    };
    let seconds = number.parse::<f64>().ok().map(|value| value * factor);
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| format!("`{text}` is no time: write 500ms, 2s or 1min"))
}
