//! `endurance`: runs a moving cell under load from all sides and prints the result as tables; exits with 1 if a
//! condition does not hold. Runs on the main thread; see `rcc_tests::endurance`.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;
use nix::sys::signal::{SigSet, Signal};
use rcc_tests::endurance::{Options, run};
use rcc_tests::journal::Journal;

/// Runs a moving cell under load from all sides; every late cycle must be explained, no resource may grow, and nothing
/// may move unrequested.
#[derive(Debug, Parser)]
struct Arguments {
    /// Minimum duration
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// Seed of all random choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of driver restarts after a kill; four fifths are those of the I/O station's driver
    #[arg(long, default_value_t = 20)]
    restarts: u64,
    /// Number of monitors that start, stall and end
    #[arg(long, default_value_t = 100)]
    monitors: u64,
    /// Number of times to kill two processes at the same moment
    #[arg(long, default_value_t = 20)]
    pairs: u64,
    /// Number of additional times to kill the executor and another process at the same moment
    #[arg(long, default_value_t = 2)]
    executor_pairs: u32,
    /// Run without floods, big nets, killed loaders and load on the machine
    #[arg(long)]
    no_load: bool,
    /// Folder of the cell's programs, which are copied before the cell starts [default: the folder above this
    /// program's]
    #[arg(long)]
    programs: Option<PathBuf>,
}

/// Programs that a cell needs.
const PROGRAMS: [&str; 8] = [
    "rcc-cli",
    "rcc-exec",
    "rcc-loader",
    "rcc-driver",
    "rcc-janitor",
    "rcc-monitor",
    "lwr-sim",
    "io-sim",
];

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let Some(copies) = std::env::var_os("RCC_PROGRAMS").map(PathBuf::from) else {
        let error = with_copies(&arguments);
        eprintln!("endurance: {error}");
        return ExitCode::FAILURE;
    };
    let time = Duration::from_secs_f64(arguments.minutes * 60.0);
    let options = Options {
        time,
        seed: arguments.seed,
        restarts: arguments.restarts,
        monitors: arguments.monitors,
        pairs: arguments.pairs,
        executor_pairs: arguments.executor_pairs,
        load: !arguments.no_load,
        warm_up: (time / 6).min(Duration::from_secs(90)),
        census_every: Duration::from_secs(60),
    };
    let journal = Arc::new(Journal::default());
    if let Err(error) = end_with_signal(&journal) {
        eprintln!("endurance: {error}");
        return ExitCode::FAILURE;
    }
    let report = run(options, &journal);
    println!("{report}");
    if copies.starts_with(std::env::temp_dir()) {
        // A leftover copy only takes disk space.
        let _ = std::fs::remove_dir_all(&copies);
    }
    ExitCode::from(u8::from(!report.holds()))
}

/// Makes SIGINT and SIGTERM end the run in order, with a report on the time until then. Must be called before the first
/// thread starts, so that every thread inherits the blocked signals.
fn end_with_signal(journal: &Arc<Journal>) -> nix::Result<()> {
    let signals: SigSet = [Signal::SIGINT, Signal::SIGTERM].into_iter().collect();
    signals.thread_block()?;
    let journal = Arc::clone(journal);
    std::thread::spawn(move || {
        if signals.wait().is_ok() {
            journal.end();
        }
    });
    Ok(())
}

/// Copies the programs, so that a build during the run does not replace them, and executes this program again with the
/// copies. Returns only on an error.
fn with_copies(arguments: &Arguments) -> std::io::Error {
    let copy = || -> std::io::Result<PathBuf> {
        let this = std::env::current_exe()?;
        let beside = this.ancestors().nth(2).unwrap_or(Path::new("/"));
        let from = arguments.programs.as_deref().unwrap_or(beside);
        let to = std::env::temp_dir().join(format!("rcc-endurance-{}", std::process::id()));
        std::fs::create_dir_all(&to)?;
        for name in PROGRAMS {
            std::fs::copy(from.join(name), to.join(name))?;
        }
        Ok(to)
    };
    match copy() {
        Ok(folder) => Command::new("/proc/self/exe")
            .args(std::env::args_os().skip(1))
            .env("RCC_JANITOR", folder.join("rcc-janitor"))
            .env("RCC_PROGRAMS", folder)
            .exec(),
        Err(error) => error,
    }
}
