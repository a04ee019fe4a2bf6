//! Cleans up after dead processes: half-created shared memory, dead nodes (in a separate process) and whole dead cells.
//! Runs in supervisors and in `rcc-janitor`, never on a real-time thread.

use std::io;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::cell::Cell;
use crate::session::SessionError;
use crate::shm_space::SHM;

mod half_created;
mod janitor;

pub use half_created::{HALF_CREATED_AFTER, remove_half_created};
pub use janitor::clean_as_janitor;

pub use crate::shm_space::ForeignFile;
pub use crate::wipe::{WipeError, WipeReport, remove_cell, wipe};

/// Default time limit of a janitor; the longest run ever measured took 34 ms.
pub const JANITOR_TIMEOUT: Duration = Duration::from_secs(1);

const JANITOR: &str = "rcc-janitor";
/// Polling interval for a child that should end soon.
const WAIT_STEP: Duration = Duration::from_millis(2);

/// Result of one run of the janitor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct CleanReport {
    /// Half-created shared-memory files that were removed first.
    pub half_created: usize,
    /// Dead nodes that iceoryx2 cleaned up.
    pub dead_nodes: u64,
    /// Files and folders of dead processes that iceoryx2 left behind.
    pub reaped: usize,
}

/// Error while cleaning.
#[derive(Debug, thiserror::Error)]
pub enum CleanError {
    /// The system refuses a thread.
    #[error(
        "cannot create a thread for the janitor ({0}): raise TasksMax= or pids.max of its control group"
    )]
    Thread(io::Error),
    /// The janitor program is missing.
    #[error(
        "{JANITOR} is not at {looked:?}: install it beside this program, or set RCC_JANITOR to its path"
    )]
    NoProgram {
        /// Paths that were tried.
        looked: Vec<PathBuf>,
    },
    /// The janitor cannot be started or waited for.
    #[error("{program}: {source}")]
    Process {
        /// The program.
        program: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
    /// The janitor did not end in time and was killed.
    #[error(
        "{JANITOR} for cell `{cell}` did not end within {timeout:?} and was killed: run it again"
    )]
    TimedOut {
        /// The cell.
        cell: String,
        /// The time limit.
        timeout: Duration,
    },
    /// The janitor ended with an error.
    #[error("{JANITOR} for cell `{cell}`: {output_text}")]
    Failed {
        /// The cell.
        cell: String,
        /// Its error output.
        output_text: String,
    },
    /// This process cannot join the cell in order to clean it.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Not enough shared memory to join the cell, and nothing more that may be removed.
    #[error(
        "{SHM} has {have} bytes free, cleaning needs {need}; {freed} files of dead processes were removed: remove old files there (`rcc-cli doctor --clean` finds those of RCC), or enlarge it (mount -o remount,size=)"
    )]
    Full {
        /// Number of files that were removed.
        freed: usize,
        /// Bytes free now.
        have: u64,
        /// Bytes needed.
        need: u64,
    },
    /// Files cannot be listed or removed.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
}

/// Runs the janitor as a separate process and kills it after `timeout` (usually [`JANITOR_TIMEOUT`]).
///
/// # Errors
/// Returns an error if the program is missing, if it timed out (run it again), or if the janitor itself failed.
pub fn run_janitor(cell: &Cell, timeout: Duration) -> Result<CleanReport, CleanError> {
    let mut janitor = Command::new(janitor_program()?);
    janitor
        .args(["--cell", cell.name()])
        .arg("--runtime-dir")
        .arg(cell.runtime_dir())
        .arg("--state-dir")
        .arg(cell.state_anchor());
    run_within(janitor, cell, timeout)
}

/// Runs a program that prints a report, and kills it after `timeout`.
fn run_within(
    mut janitor: Command,
    cell: &Cell,
    timeout: Duration,
) -> Result<CleanReport, CleanError> {
    let program = PathBuf::from(janitor.get_program());
    let failed = |source| CleanError::Process {
        program: program.clone(),
        source,
    };
    let mut child = janitor
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    let limit = Instant::now() + timeout;
    while child.try_wait().map_err(failed)?.is_none() {
        if Instant::now() >= limit {
            child.kill().map_err(failed)?;
            child.wait().map_err(failed)?;
            return Err(CleanError::TimedOut {
                cell: cell.name().to_owned(),
                timeout,
            });
        }
        thread::sleep(WAIT_STEP);
    }
    // The output is smaller than a pipe buffer, so the janitor never blocked on it.
    let output = child.wait_with_output().map_err(failed)?;
    let output_text = |text: &[u8]| String::from_utf8_lossy(text).trim().to_owned();
    if !output.status.success() {
        let output_text = output_text(&output.stderr);
        return Err(CleanError::Failed {
            cell: cell.name().to_owned(),
            output_text,
        });
    }
    serde_json::from_slice(&output.stdout).map_err(|_| CleanError::Failed {
        cell: cell.name().to_owned(),
        output_text: format!("unexpected output: {}", output_text(&output.stdout)),
    })
}

/// Returns `$RCC_JANITOR`, else the program next to this one, else one folder up (test programs are in a subfolder).
fn janitor_program() -> Result<PathBuf, CleanError> {
    if let Some(program) = std::env::var_os("RCC_JANITOR").filter(|value| !value.is_empty()) {
        return Ok(program.into());
    }
    let here = std::env::current_exe().unwrap_or_default();
    let looked: Vec<PathBuf> = here
        .ancestors()
        .skip(1)
        .take(2)
        .map(|folder| folder.join(JANITOR))
        .collect();
    match looked.iter().find(|path| path.is_file()) {
        Some(program) => Ok(program.clone()),
        None => Err(CleanError::NoProgram { looked }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_janitor_that_hangs_is_killed() {
        let base = rcc_testing::folder();
        let cell = Cell::at("demo", base.path()).unwrap();
        let mut hanging = Command::new("sleep");
        hanging.arg("infinity");
        let started = Instant::now();
        let result = run_within(hanging, &cell, Duration::from_millis(20));
        assert!(
            matches!(result, Err(CleanError::TimedOut { .. })),
            "{result:?}"
        );
        assert!(started.elapsed() >= Duration::from_millis(20));
    }
}
