//! `rcc-monitor`: shows the values of a cell's nets, in a terminal (`tail`) or in browsers (`serve`), and records them
//! (`record`).

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand};
use nix::sys::signal::Signal;
use rcc_core::duration::parse_seconds;
use rcc_core::printable::Printable;
use rcc_monitor::reader;
use rcc_monitor::record::{RecordOptions, record};
use rcc_monitor::serve::{ServeOptions, serve};
use rcc_monitor::signals::Signals;
use rcc_monitor::tail::{Format, TailEnd, TailOptions, print_note, tail};
use rcc_protocol::pattern::Pattern;
use rcc_reading::selection::{PortPattern, Selection};
use rcc_recording::recording::WhenFull;

/// Shows the values of a cell's nets.
#[derive(Parser)]
#[command(version = rcc_protocol::version::version())]
struct Arguments {
    /// Name of the cell.
    #[arg(long, env = "RCC_CELL", default_value = "demo", global = true)]
    cell: String,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Print values as they arrive.
    Tail {
        /// Ports such as line/move.pose or line/ik.joints[2]; * and ? match any characters. Default: all.
        patterns: Vec<Pattern>,
        /// Output format.
        #[arg(long, value_enum, default_value = "human")]
        output: Format,
        /// Stop after this many records.
        #[arg(long)]
        count: Option<u64>,
        /// Stop after this time: 500ms, 2s, 1min.
        #[arg(long = "for", value_name = "DURATION", value_parser = duration)]
        duration: Option<Duration>,
    },
    /// Serve the dashboard for browsers on this machine, and print its address.
    Serve {
        /// TCP port on 127.0.0.1; 0 takes any free one. Default: 7426, or any free one if it is in use.
        #[arg(long)]
        port: Option<u16>,
        /// Refuse START; CANCEL and ABORT are always possible.
        #[arg(long)]
        no_start: bool,
        /// File with the token that readers of /metrics must send; only its owner may read it.
        #[arg(long, value_name = "FILE")]
        metrics_token: Option<PathBuf>,
        /// Let every program of this machine read /metrics without a token.
        #[arg(long, conflicts_with = "metrics_token")]
        metrics_open: bool,
        /// End with the process that started this one.
        #[arg(long)]
        parent_death: bool,
    },
    /// Record the monitors of nets, the devices, the events and the health of the cell to an MCAP file.
    Record(RecordArguments),
}

#[derive(clap::Args)]
struct RecordArguments {
    /// The file; one that exists is kept, and is an error.
    file: PathBuf,
    /// Nets, separated by commas, with * and ? as wildcards. Default: all.
    #[arg(long, value_delimiter = ',', value_name = "NET")]
    nets: Vec<Pattern>,
    /// Monitored ports such as line/move.pose or */ik.joints, separated by commas; * and ? match any characters. Default:
    /// all.
    #[arg(long, value_delimiter = ',', value_name = "PORT")]
    ports: Vec<PortPattern>,
    /// Stop after this time, s. Default: at Ctrl-C.
    #[arg(long, value_parser = seconds)]
    seconds: Option<Duration>,
    /// Greatest size: 500MB, 2GB.
    #[arg(long, default_value = "4GB", value_parser = bytes)]
    max_size: u64,
    /// At the greatest size, remove the oldest eighth instead of ending; the file becomes numbered segments.
    #[arg(long)]
    keep_newest: bool,
    /// Rate of the messages that draw an arm, Hz; its measurements are all recorded.
    #[arg(long, default_value = "100", value_parser = rate)]
    view_rate: f64,
    /// Output format of the report.
    #[arg(long, value_enum, default_value = "human")]
    output: Format,
}

/// Exit code after Ctrl-C, as shells use it.
const INTERRUPTED: u8 = 130;
/// Exit code when the reader of the output is gone: the code that a shell shows for a program ended by SIGPIPE.
const READER_GONE: u8 = 141;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // If memory runs out, the kernel should first end processes that only observe; raising the score is always allowed,
    // see proc(5).
    let _ = std::fs::write("/proc/self/oom_score_adj", "500");
    let mut signals = match Signals::catch() {
        Ok(signals) => signals,
        Err(error) => {
            print_note(&format!("error: cannot catch signals: {error}"));
            return ExitCode::FAILURE;
        }
    };
    match arguments.verb {
        Verb::Tail {
            patterns,
            output,
            count,
            duration,
        } => {
            let options = TailOptions {
                patterns,
                format: output,
                count,
                duration,
            };
            run_tail(&arguments.cell, &options, &mut signals)
        }
        Verb::Record(record) => run_record(&arguments.cell, record, &mut signals),
        Verb::Serve {
            port,
            no_start,
            metrics_token,
            metrics_open,
            parent_death,
        } => {
            if parent_death && let Err(error) = rcc_process::signals::end_with_parent() {
                print_note(&format!("error: {error}"));
                return ExitCode::FAILURE;
            }
            let options = ServeOptions {
                cell: arguments.cell,
                port,
                may_start: !no_start,
                metrics_token,
                metrics_open,
            };
            concluded(serve(&options, &mut signals, &mut io::stdout()))
        }
    }
}

fn run_record(cell: &str, arguments: RecordArguments, signals: &mut Signals) -> ExitCode {
    let options = RecordOptions {
        path: arguments.file,
        selection: Selection {
            nets: arguments.nets,
            ports: arguments.ports,
        },
        duration: arguments.seconds,
        bytes_max: arguments.max_size,
        when_full: match arguments.keep_newest {
            true => WhenFull::RemoveOldest,
            false => WhenFull::Stop,
        },
        view_hz: arguments.view_rate,
    };
    let report = match record(cell, &options, signals) {
        Ok(report) => report,
        Err(error) => return concluded(Err(error)),
    };
    let lines = match arguments.output {
        Format::Human => report.lines(),
        Format::Json => vec![serde_json::to_string(&report).unwrap_or_default()],
    };
    let mut out = io::stdout().lock();
    for line in lines {
        // An error is ignored: the reader has closed the output.
        let _ = writeln!(out, "{}", Printable(&line));
    }
    ExitCode::SUCCESS
}

fn run_tail(cell: &str, options: &TailOptions, signals: &mut Signals) -> ExitCode {
    let mut out = BufWriter::new(io::stdout().lock());
    let ended = tail(cell, options, signals, &mut out, || {
        reader::is_gone(&io::stdout())
    });
    match ended {
        Ok(TailEnd::Signal(signal)) => concluded(Ok::<_, std::convert::Infallible>(signal)),
        Ok(TailEnd::ReaderGone) => ExitCode::from(READER_GONE),
        Ok(TailEnd::Done) => ExitCode::SUCCESS,
        Err(error) => concluded(Err(error)),
    }
}

/// Returns the exit code of a program that was ended by a signal or an error.
fn concluded(ended: Result<i32, impl std::fmt::Display>) -> ExitCode {
    match ended {
        Ok(signal) if signal == Signal::SIGINT as i32 => ExitCode::from(INTERRUPTED),
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            print_note(&format!("error: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let seconds = parse_seconds(text).ok();
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| format!("invalid duration `{text}`: write 500ms, 2s or 1min"))
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.trim().parse::<f64>().ok().filter(|one| *one > 0.0);
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| format!("invalid number of seconds `{text}`: write 10 or 0.5"))
}

fn rate(text: &str) -> Result<f64, String> {
    let rate = text.trim().parse::<f64>().ok();
    rate.filter(|rate| (0.1..=1000.0).contains(rate))
        .ok_or_else(|| format!("invalid rate `{text}`: write a number from 0.1 to 1000, in Hz"))
}

/// Smallest size of a recording: its schemas must fit into each eighth.
const SIZE_MIN: f64 = 4e6;

fn bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let units = [("GB", 1e9), ("MB", 1e6)];
    let found = units.iter().find_map(|(unit, factor)| {
        let number = text.strip_suffix(unit)?.trim().parse::<f64>().ok()?;
        Some(number * factor).filter(|bytes| (SIZE_MIN..=1e15).contains(bytes))
    });
    found
        .map(|bytes| bytes as u64)
        .ok_or_else(|| format!("invalid size `{text}`: write 4MB or more, such as 500MB or 2GB"))
}
