//! Cleans up after dead processes: half-created shared memory, dead nodes (in a separate process) and whole dead cells.
//! Runs in supervisors and in `rcc-janitor`, never on a real-time thread.

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rcc_protocol::Role;

use crate::announce::AnnounceError;
use crate::cell::{Cell, CellError, is_simulator_socket};
use crate::lock::LockError;
use crate::ownership;
use crate::ownership::ExclusiveAccess;
use crate::session::SessionError;
use crate::shm_space::SHM;

mod half_created;
mod janitor;

pub use half_created::{HALF_CREATED_AFTER, remove_half_created};
pub use janitor::clean_as_janitor;

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

/// Result of a wipe.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WipeReport {
    /// Shared-memory files.
    pub shared_memory: usize,
    /// Announcements of dead processes.
    pub announcements: usize,
}

/// Error while wiping a cell.
#[derive(Debug, thiserror::Error)]
pub enum WipeError {
    /// A process of the cell is alive.
    #[error(
        "cell `{cell}` is alive: {role} `{label}` is running (pid {pid}); stop it, or use another cell"
    )]
    Living {
        /// The cell.
        cell: String,
        /// Role of the live process.
        role: Role,
        /// Label of the live process.
        label: String,
        /// Its process id.
        pid: u32,
    },
    /// A process is in the cell but has not announced itself.
    #[error(
        "cell `{cell}` is in use by a process that has not announced itself: end it (`fuser {lock}` shows which)"
    )]
    InUse {
        /// The cell.
        cell: String,
        /// File that the process has locked.
        lock: PathBuf,
    },
    /// The lock of the cell cannot be used.
    #[error(transparent)]
    Lock(LockError),
    /// The announcements cannot be read.
    #[error(transparent)]
    Announce(#[from] AnnounceError),
    /// The folders cannot be created again.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// A file cannot be removed.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
}

impl Cell {
    /// Returns everything of this cell in `/dev/shm`, in use or left behind: its shared-memory files, and the files in
    /// iceoryx2's folder (the folder itself if it is empty). In a cell without processes all of it is left behind.
    ///
    /// # Errors
    /// Returns an error if `/dev/shm` cannot be read.
    pub fn leftovers(&self) -> io::Result<Vec<PathBuf>> {
        let mut found = self.shared_memory()?;
        let root = self.iox_root();
        match files_below(&root)? {
            Some(files) if files.is_empty() => found.push(root),
            files => found.extend(files.unwrap_or_default()),
        }
        found.sort();
        Ok(found)
    }

    /// Returns the shared-memory files of this cell that belong to this user.
    pub(crate) fn shared_memory(&self) -> io::Result<Vec<PathBuf>> {
        let root = self.iox_root();
        let (mut ours, _) = below_prefix(self.prefix())?;
        ours.retain(|path| *path != root);
        Ok(ours)
    }

    /// Returns the files of other users under this cell's prefix, with their owners. They are not part of the cell and
    /// we may not remove them.
    ///
    /// # Errors
    /// Returns an error if `/dev/shm` cannot be read.
    pub fn foreign(&self) -> io::Result<Vec<ForeignFile>> {
        Ok(below_prefix(self.prefix())?.1)
    }
}

/// A file in `/dev/shm` that another user created under a cell's prefix.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForeignFile {
    /// The file or folder.
    pub path: PathBuf,
    /// User id of the owner.
    pub owner: u32,
}

/// Lists the files in `/dev/shm` that start with `prefix`, sorted by name: ours, and those of other users.
pub(crate) fn below_prefix(prefix: &str) -> io::Result<(Vec<PathBuf>, Vec<ForeignFile>)> {
    let uid = nix::unistd::getuid().as_raw();
    let (mut ours, mut foreign) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(SHM)? {
        let entry = entry?;
        let name = entry.file_name();
        if !name.as_encoded_bytes().starts_with(prefix.as_bytes()) {
            continue;
        }
        // The owner removed it meanwhile.
        let Ok(found) = entry.metadata() else {
            continue;
        };
        let (path, owner) = (entry.path(), found.uid());
        if owner == uid {
            ours.push(path);
        } else {
            foreign.push(ForeignFile { path, owner });
        }
    }
    ours.sort();
    foreign.sort_by(|a, b| a.path.cmp(&b.path));
    Ok((ours, foreign))
}

/// Returns all files below a folder, or `None` if the folder does not exist.
fn files_below(folder: &Path) -> io::Result<Option<Vec<PathBuf>>> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut files = Vec::new();
    for entry in entries {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            files.extend(files_below(&entry.path())?.unwrap_or_default());
        } else {
            files.push(entry.path());
        }
    }
    Ok(Some(files))
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

/// Removes everything that a dead cell left behind, so that it can start afresh. Call it before joining: a process in
/// the cell, announced or not, is a reason to refuse. Other cells are never touched.
///
/// # Errors
/// Returns an error if the cell is alive, or if files cannot be removed.
pub fn wipe(cell: &Cell) -> Result<WipeReport, WipeError> {
    let access = ownership::lock_exclusively(cell, None)?;
    let report = wipe_locked(cell, &access)?;
    cell.make_folders()?;
    Ok(report)
}

/// Like [`wipe`], and removes the runtime folder as well, with the files that RCC keeps there. A folder that holds
/// anything else stays.
///
/// # Errors
/// As [`wipe`].
pub fn remove_cell(cell: &Cell) -> Result<WipeReport, WipeError> {
    let access = ownership::lock_exclusively(cell, None)?;
    let report = wipe_locked(cell, &access)?;
    remove_rest(cell, &access)?;
    Ok(report)
}

/// Removes the files that [`wipe_locked`] leaves, and the folder.
pub(crate) fn remove_rest(cell: &Cell, _access: &ExclusiveAccess) -> Result<(), WipeError> {
    let ours = [
        cell.config_copy(),
        cell.janitor_lock_file(),
        cell.prefix_file(),
        cell.running_file(),
        cell.next_id_file(),
        cell.next_id_file().with_extension("new"),
    ];
    for path in ours {
        remove_file(&path).map_err(|source| WipeError::File { path, source })?;
    }
    remove_simulator_sockets(cell).map_err(|source| WipeError::File {
        path: cell.runtime_dir().to_owned(),
        source,
    })?;
    let own_state = cell.state_anchor().to_owned();
    let own_state = Some(own_state).filter(|state| state.starts_with(cell.runtime_dir()));
    for path in own_state.into_iter().chain([cell.supervisor_dir()]) {
        remove_folder(&path).map_err(|source| WipeError::File { path, source })?;
    }
    // Remove the lock last: from now on another process may create a new lock file and own the cell.
    let path = cell.lock_file();
    remove_file(&path).map_err(|source| WipeError::File { path, source })?;
    // If it is not empty, it holds files of somebody else, or a new cell; we may not remove them.
    let _ = fs::remove_dir(cell.runtime_dir());
    if let Some(base) = cell.own_base() {
        // If it is not empty, it holds other cells. A cell that is just being created creates it again.
        let _ = fs::remove_dir(base);
    }
    Ok(())
}

/// Removes the files of one run of the cell.
pub(crate) fn wipe_locked(cell: &Cell, access: &ExclusiveAccess) -> Result<WipeReport, WipeError> {
    let mut report = WipeReport {
        announcements: access.announced.len(),
        shared_memory: 0,
    };
    let shared = cell.shared_memory().map_err(|source| WipeError::File {
        path: SHM.into(),
        source,
    })?;
    for path in shared {
        let removed = remove_file(&path).map_err(|source| WipeError::File { path, source })?;
        report.shared_memory += usize::from(removed);
    }
    for path in [
        cell.iox_root(),
        cell.processes_dir(),
        cell.commands_dir(),
        cell.drivers_dir(),
    ] {
        remove_folder(&path).map_err(|source| WipeError::File { path, source })?;
    }
    let path = cell.socket();
    remove_file(&path).map_err(|source| WipeError::File { path, source })?;
    Ok(report)
}

/// Writes a file that only its owner may read.
pub(crate) fn write_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut options = fs::OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(0o600);
    options.open(path)?.write_all(bytes)
}

/// Removes the control sockets of killed simulators. A simulator is not a process of the cell and may still be alive;
/// then it removes its socket itself.
fn remove_simulator_sockets(cell: &Cell) -> io::Result<()> {
    let entries = match fs::read_dir(cell.runtime_dir()) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        let ours = entry.file_name().to_str().is_some_and(is_simulator_socket);
        if !ours || !entry.file_type()?.is_socket() {
            continue;
        }
        let path = entry.path();
        let refused = UnixStream::connect(&path).map_err(|error| error.kind());
        if matches!(refused, Err(io::ErrorKind::ConnectionRefused)) {
            remove_file(&path)?;
        }
    }
    Ok(())
}

/// Returns whether the file existed.
fn remove_file(path: &Path) -> io::Result<bool> {
    match fs::remove_file(path) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

fn remove_folder(path: &Path) -> io::Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
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
