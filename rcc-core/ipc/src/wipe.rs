//! Wipes a dead cell: under the lock of the cell, and only if none of its processes is alive. Run by supervisors and by
//! programs that remove dead cells, never by a real-time thread.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::Flock;
use rcc_os::file;
use rcc_protocol::{Announcement, Role};

use crate::announce::AnnounceError;
use crate::cell::{Cell, is_simulator_socket};
use crate::cell_error::CellError;
use crate::lock::{self, LockError};
use crate::shm_space::SHM;

/// Time limit for the lock of the cell: a killed process counts as dead before the system has closed its files, and a
/// janitor is in the cell for a moment.
const PATIENCE: Duration = Duration::from_secs(2);
/// Interval between attempts.
const RETRY: Duration = Duration::from_millis(2);

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

/// Proof that no other process is in the cell and that none can join.
#[derive(Debug)]
pub(crate) struct ExclusiveAccess {
    /// All announced processes; all are dead except possibly the caller.
    pub(crate) announced: Vec<Announcement>,
    _lock: Flock<File>,
}

/// Waits for the exclusive lock of the cell, unless an announced process other than `own` is alive.
pub(crate) fn lock_exclusively(
    cell: &Cell,
    own: Option<&Announcement>,
) -> Result<ExclusiveAccess, WipeError> {
    let limit = Instant::now() + PATIENCE;
    loop {
        match attempt(cell, own) {
            // Another process just removed the folder, or is about to leave.
            Err(error) if is_passing(&error) && Instant::now() < limit => thread::sleep(RETRY),
            result => return result,
        }
    }
}

fn attempt(cell: &Cell, own: Option<&Announcement>) -> Result<ExclusiveAccess, WipeError> {
    cell.make_folders()?;
    refuse_living(cell, own)?;
    let lock = lock::exclusive(&cell.lock_file()).map_err(|error| match error {
        LockError::Held { path } => WipeError::InUse {
            cell: cell.name().to_owned(),
            lock: path,
        },
        other => WipeError::Lock(other),
    })?;
    // A process that announced itself in between is found here; none can from now on.
    let announced = refuse_living(cell, own)?;
    Ok(ExclusiveAccess {
        announced,
        _lock: lock,
    })
}

fn is_passing(error: &WipeError) -> bool {
    let gone = |error: &io::Error| error.kind() == io::ErrorKind::NotFound;
    match error {
        WipeError::InUse { .. } => true,
        WipeError::Cell(error) => error.is_passing(),
        WipeError::Lock(LockError::File { source, .. })
        | WipeError::Announce(AnnounceError::File { source, .. }) => gone(source),
        _ => false,
    }
}

/// Returns all announcements, or an error if a process other than `own` is alive. The error names the supervisor if
/// possible, because the others are its children.
fn refuse_living(cell: &Cell, own: Option<&Announcement>) -> Result<Vec<Announcement>, WipeError> {
    let announced = cell.announced_all()?;
    let other = |one: &&Announcement| own.is_none_or(|own| own.incarnation != one.incarnation);
    // A process that may be alive counts as alive.
    let living = announced
        .iter()
        .filter(other)
        .filter(|one| !one.liveness().is_dead());
    match living.max_by_key(|one| one.is_supervisor()) {
        None => Ok(announced),
        Some(living) => Err(WipeError::Living {
            cell: cell.name().to_owned(),
            role: living.role,
            label: living.label.clone(),
            pid: living.pid,
        }),
    }
}

/// Removes everything that a dead cell left behind, so that it can start afresh. Call it before joining: a process in
/// the cell, announced or not, is a reason to refuse. Other cells are never touched.
///
/// # Errors
/// Returns an error if the cell is alive, or if files cannot be removed.
pub fn wipe(cell: &Cell) -> Result<WipeReport, WipeError> {
    let access = lock_exclusively(cell, None)?;
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
    let access = lock_exclusively(cell, None)?;
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
        file::temporary(&cell.running_file()),
        cell.next_id_file(),
        file::temporary(&cell.next_id_file()),
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
pub(crate) fn remove_file(path: &Path) -> io::Result<bool> {
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
