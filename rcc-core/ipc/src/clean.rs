//! Cleaning after dead processes: half-created shared memory, dead nodes (in a process of its own), whole dead cells.
//! Run by supervisors and by `rcc-janitor`, never by a real-time thread.

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::announce::AnnounceError;
use crate::cell::{Cell, CellError, is_simulator_socket};
use crate::lock::LockError;
use crate::ownership;
use crate::ownership::ExclusiveAccess;
use crate::session::{Role, SessionError};
use crate::shm_space::SHM;

mod half_created;
mod janitor;

pub use half_created::{HALF_CREATED_AFTER, remove_half_created};
pub use janitor::clean_as_janitor;

/// How long a janitor may take, unless the caller says otherwise: 34 ms were the most ever seen.
pub const JANITOR_TIMEOUT: Duration = Duration::from_secs(1);

const JANITOR: &str = "rcc-janitor";
/// How often a child that should end soon is looked at.
const WAIT_STEP: Duration = Duration::from_millis(2);

/// What one run of the janitor did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct CleanReport {
    /// Half-created shared-memory files removed before cleaning.
    pub half_created: usize,
    /// Dead nodes that iceoryx2 cleaned up.
    pub dead_nodes: u64,
    /// Files and folders of dead processes that iceoryx2 had left.
    pub reaped: usize,
}

/// Why cleaning did not succeed.
#[derive(Debug, thiserror::Error)]
pub enum CleanError {
    /// The system gives no thread.
    #[error("the janitor gets no thread: {0}; raise TasksMax= or pids.max of its group")]
    Thread(io::Error),
    /// The janitor's program is missing.
    #[error(
        "{JANITOR} is not at {looked:?}: install it beside this program, or set RCC_JANITOR to its path"
    )]
    NoProgram {
        /// Where it was looked for.
        looked: Vec<PathBuf>,
    },
    /// The janitor could not be started or waited for.
    #[error("{program}: {source}")]
    Process {
        /// The program.
        program: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The janitor did not end and was killed.
    #[error(
        "{JANITOR} for cell '{cell}' did not end within {timeout:?} and was killed: run it again"
    )]
    TimedOut {
        /// The cell.
        cell: String,
        /// The time it had.
        timeout: Duration,
    },
    /// The janitor ended with an error of its own.
    #[error("{JANITOR} for cell '{cell}': {words}")]
    Failed {
        /// The cell.
        cell: String,
        /// What it said.
        words: String,
    },
    /// This process could not enter the cell in order to clean.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// No room to enter the cell, and nothing more that is ours to remove.
    #[error(
        "{SHM} has {have} bytes free, cleaning needs {need}; {freed} files of dead processes were removed: remove old files there (`rcc-cli doctor --clean` finds those of RCC), or enlarge it (mount -o remount,size=)"
    )]
    Full {
        /// Files that went.
        freed: usize,
        /// Bytes free now.
        have: u64,
        /// Bytes needed.
        need: u64,
    },
    /// Files could not be listed or removed.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// What a wipe removed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WipeReport {
    /// Shared-memory files.
    pub shared_memory: usize,
    /// Announcements of dead processes.
    pub announcements: usize,
}

/// Why a cell was not wiped.
#[derive(Debug, thiserror::Error)]
pub enum WipeError {
    /// A process of it lives.
    #[error(
        "cell '{cell}' is alive: {role} '{label}' runs (process {pid}); stop it, or use another cell"
    )]
    Living {
        /// The cell.
        cell: String,
        /// Who lives.
        role: Role,
        /// Which one.
        label: String,
        /// Its process.
        pid: u32,
    },
    /// A process is in it that has not announced itself.
    #[error(
        "cell '{cell}' is in use by a process that has no name there; end it (`fuser {lock}` tells which)"
    )]
    InUse {
        /// The cell.
        cell: String,
        /// The file that process has locked.
        lock: PathBuf,
    },
    /// The lock of the cell cannot be used.
    #[error(transparent)]
    Lock(LockError),
    /// The announcements cannot be read.
    #[error(transparent)]
    Announce(#[from] AnnounceError),
    /// The folders cannot be made again.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// A file could not be removed.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl Cell {
    /// What lies in `/dev/shm` for this cell, used or left behind: its shared-memory files, and the files in iceoryx2's
    /// folder, or that folder itself when it is empty. In a cell without processes all are left behind.
    ///
    /// # Errors
    /// `/dev/shm` cannot be read.
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

    /// The shared-memory files of this cell that belong to this user.
    pub(crate) fn shared_memory(&self) -> io::Result<Vec<PathBuf>> {
        let root = self.iox_root();
        let (mut ours, _) = below_prefix(self.prefix())?;
        ours.retain(|path| *path != root);
        Ok(ours)
    }

    /// What others have laid under this cell's prefix, with its owner: nothing of the cell, and not ours to remove.
    ///
    /// # Errors
    /// `/dev/shm` cannot be read.
    pub fn foreign(&self) -> io::Result<Vec<ForeignFile>> {
        Ok(below_prefix(self.prefix())?.1)
    }
}

/// A file in `/dev/shm` that another user has laid under a cell's prefix.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForeignFile {
    /// The file or folder.
    pub path: PathBuf,
    /// Its owner's user id.
    pub owner: u32,
}

/// What lies in `/dev/shm` under a prefix, in the order of the names: ours, and that of other users.
pub(crate) fn below_prefix(prefix: &str) -> io::Result<(Vec<PathBuf>, Vec<ForeignFile>)> {
    let uid = nix::unistd::getuid().as_raw();
    let (mut ours, mut foreign) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(SHM)? {
        let entry = entry?;
        let name = entry.file_name();
        if !name.as_encoded_bytes().starts_with(prefix.as_bytes()) {
            continue;
        }
        // Missing now: its owner removed it in the meantime.
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

/// All files below a folder, or nothing if there is no folder.
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

/// Runs the janitor as a process of its own and kills it after `timeout` ([`JANITOR_TIMEOUT`] is usual).
///
/// # Errors
/// No program, a time-out (run it again), or what the janitor says.
pub fn run_janitor(cell: &Cell, timeout: Duration) -> Result<CleanReport, CleanError> {
    let program = janitor_program()?;
    let failed = |source| CleanError::Process {
        program: program.clone(),
        source,
    };
    let mut child = Command::new(&program)
        .arg("--cell")
        .arg(cell.name())
        .arg("--runtime-dir")
        .arg(cell.runtime_dir())
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
    // It says less than a pipe holds, so it never waited for us.
    let output = child.wait_with_output().map_err(failed)?;
    let words = |text: &[u8]| String::from_utf8_lossy(text).trim().to_owned();
    if !output.status.success() {
        let words = words(&output.stderr);
        return Err(CleanError::Failed {
            cell: cell.name().to_owned(),
            words,
        });
    }
    serde_json::from_slice(&output.stdout).map_err(|_| CleanError::Failed {
        cell: cell.name().to_owned(),
        words: format!("unexpected words: {}", words(&output.stdout)),
    })
}

/// Removes everything that a dead cell left, so that it can start as if new. Call it before joining: a process that
/// is in the cell, announced or not, is a reason to refuse. Other cells are never touched.
///
/// # Errors
/// The cell is alive, or files cannot be removed.
pub fn wipe(cell: &Cell) -> Result<WipeReport, WipeError> {
    let alone = ownership::lock_exclusively(cell, None)?;
    let report = wipe_locked(cell, &alone)?;
    cell.make_folders()?;
    Ok(report)
}

/// As [`wipe`], and removes the runtime folder itself with the files that RCC keeps there. A folder that holds
/// anything else stays.
///
/// # Errors
/// As [`wipe`].
pub fn remove_cell(cell: &Cell) -> Result<WipeReport, WipeError> {
    let alone = ownership::lock_exclusively(cell, None)?;
    let report = wipe_locked(cell, &alone)?;
    remove_rest(cell, &alone)?;
    Ok(report)
}

/// Removes what [`wipe_locked`] left, and the folder.
pub(crate) fn remove_rest(cell: &Cell, _alone: &ExclusiveAccess) -> Result<(), WipeError> {
    let ours = [
        cell.config_copy(),
        cell.janitor_lock_file(),
        cell.prefix_file(),
    ];
    for path in ours.into_iter().chain(cell.life_files()) {
        remove_file(&path).map_err(|source| WipeError::File { path, source })?;
    }
    remove_simulator_sockets(cell).map_err(|source| WipeError::File {
        path: cell.runtime_dir().to_owned(),
        source,
    })?;
    let path = cell.incidents_dir();
    remove_folder(&path).map_err(|source| WipeError::File { path, source })?;
    // Last: from now on somebody else may make another one, lock that, and have the cell.
    let path = cell.lock_file();
    remove_file(&path).map_err(|source| WipeError::File { path, source })?;
    // Not empty: somebody else's files, or his cell; they are not ours to remove.
    let _ = fs::remove_dir(cell.runtime_dir());
    if let Some(base) = cell.own_base() {
        // Not empty: other cells. One that is just being made makes it again.
        let _ = fs::remove_dir(base);
    }
    Ok(())
}

/// Removes what a life of the cell left.
pub(crate) fn wipe_locked(cell: &Cell, alone: &ExclusiveAccess) -> Result<WipeReport, WipeError> {
    let mut report = WipeReport {
        announcements: alone.announced.len(),
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

/// Removes the control ports that killed simulators left. A simulator is no process of the cell, so it may live: then it
/// removes its own.
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

/// True when the file was there.
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

/// `$RCC_JANITOR`, else beside this program, else one folder up (where a test's program lies in a folder of its own).
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
