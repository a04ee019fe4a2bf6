//! Cleaning after dead processes: half-created shared memory, dead nodes (in a process of its own), whole dead cells.
//! Run by supervisors and by `rcc-janitor`, never by a real-time thread.

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use iceoryx2::prelude::{Config, FilePath, SemanticString};

use crate::announce::{AnnounceError, Announcement};
use crate::cell::{Cell, CellError};
use crate::lock::{self, LockError};
use crate::reap;
use crate::room::SHM;
use crate::session::{self, Role, SessionError};

/// A shared-memory file still empty after this time was left by a process that died between making and sizing it.
pub const HALF_CREATED_AFTER: Duration = Duration::from_millis(300);
/// How long a janitor may take, unless the caller says otherwise: 34 ms were the most ever seen.
pub const JANITOR_TIMEOUT: Duration = Duration::from_secs(1);

/// A killed process counts as dead before the system has closed its files; so long a wipe waits for its lock.
const DYING: Duration = Duration::from_secs(2);

const JANITOR: &str = "rcc-janitor";
/// How often a child that should end soon is looked at.
const WAIT_STEP: Duration = Duration::from_millis(2);
/// How often the janitor removes half-created files while it cleans.
const SWEEP_STEP: Duration = Duration::from_millis(50);

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

    /// The shared-memory files of this cell.
    pub(crate) fn shared_memory(&self) -> io::Result<Vec<PathBuf>> {
        let root = self.iox_root();
        let mut found = Vec::new();
        for entry in fs::read_dir(SHM)? {
            let entry = entry?;
            let ours = entry
                .file_name()
                .as_encoded_bytes()
                .starts_with(self.prefix().as_bytes());
            if ours && entry.path() != root {
                found.push(entry.path());
            }
        }
        found.sort();
        Ok(found)
    }
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

/// Removes this cell's shared-memory files that are still empty after [`HALF_CREATED_AFTER`]; returns how many.
/// iceoryx2 0.10.0 waits for such a file for ever, so this frees threads that hang there. Uses no iceoryx2 itself:
/// any thread may call it at any time.
///
/// # Errors
/// `/dev/shm` cannot be read, or a file cannot be removed.
pub fn remove_half_created(cell: &Cell) -> Result<usize, CleanError> {
    let failed = |path: &Path, source| CleanError::File {
        path: path.to_owned(),
        source,
    };
    let mut removed = 0;
    for path in cell
        .shared_memory()
        .map_err(|source| failed(Path::new(SHM), source))?
    {
        // Missing now: its owner removed it in the meantime.
        let Ok(found) = fs::metadata(&path) else {
            continue;
        };
        let age = found
            .modified()
            .ok()
            .and_then(|made| SystemTime::now().duration_since(made).ok());
        if found.len() == 0 && age.is_some_and(|age| age >= HALF_CREATED_AFTER) {
            removed += usize::from(remove_file(&path).map_err(|source| failed(&path, source))?);
        }
    }
    Ok(removed)
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

/// What the janitor's process does. It may hang for ever in iceoryx2, so nobody else calls it.
///
/// # Errors
/// The cell cannot be entered, or files cannot be removed.
pub fn be_the_janitor(cell: &Cell) -> Result<CleanReport, CleanError> {
    let half_created = remove_half_created(cell)?;
    let beside = cell.clone();
    // Files that were too young just now; the thread ends with the process.
    let sweeping = thread::Builder::new().name("sweep".into()).spawn(move || {
        loop {
            thread::sleep(SWEEP_STEP);
            // What cannot be removed now is tried again.
            let _ = remove_half_created(&beside);
        }
    });
    sweeping.map_err(CleanError::Thread)?;
    cell.make_iox_root().map_err(SessionError::from)?;
    use_as_global_configuration(cell)?;
    let (_membership, node) = session::enter(cell)?;
    // One at a time: a second one would fail on what the first removes.
    let _alone =
        lock::exclusive_within(&cell.janitor_lock_file(), JANITOR_TIMEOUT).map_err(|source| {
            SessionError::Lock {
                cell: cell.name().to_owned(),
                source,
            }
        })?;
    // First iceoryx2, which also strikes the dead out of what they shared with the living; then what it left.
    let failed = |(path, source)| CleanError::File { path, source };
    let dead = reap::Dead::of(cell).map_err(failed)?;
    let dead_nodes = node.try_cleanup_dead_nodes().cleanups;
    let reaped = reap::reap(cell, &dead).map_err(failed)?;
    Ok(CleanReport {
        half_created,
        dead_nodes,
        reaped,
    })
}

/// For dead nodes that left no details iceoryx2 falls back to its process-wide configuration; without this it would
/// look for them under its defaults.
fn use_as_global_configuration(cell: &Cell) -> Result<(), CleanError> {
    let path = cell
        .iox_root()
        .join(format!("janitor-{}.toml", std::process::id()));
    let failed = |source| CleanError::File {
        path: path.clone(),
        source,
    };
    let quoted = |text: &str| serde_json::Value::from(text).to_string();
    let text = format!(
        "[global]\nroot-path = {}\nprefix = {}\n[global.node]\ncleanup-dead-nodes-on-creation = false\n\
         cleanup-dead-nodes-on-destruction = false\n[global.service]\ncleanup-dead-nodes-on-open = false\n",
        quoted(&cell.iox_root().display().to_string()),
        quoted(cell.prefix()),
    );
    write_private(&path, text.as_bytes()).map_err(failed)?;
    let taken = FilePath::new(path.as_os_str().as_encoded_bytes())
        .ok()
        .and_then(|file| Config::setup_global_config_from_file(&file).ok());
    remove_file(&path).map_err(failed)?;
    match taken {
        Some(_) => Ok(()),
        None => Err(failed(io::Error::other(
            "iceoryx2 does not take this configuration",
        ))),
    }
}

/// Removes everything that a dead cell left, so that it can start as if new. Call it before joining: a process that
/// is in the cell, announced or not, is a reason to refuse. Other cells are never touched.
///
/// # Errors
/// The cell is alive, or files cannot be removed.
pub fn wipe(cell: &Cell) -> Result<WipeReport, WipeError> {
    let (report, _alone) = wipe_alone(cell)?;
    cell.make_folders()?;
    Ok(report)
}

/// As [`wipe`], and removes the runtime folder itself with the files that RCC keeps there. A folder that holds
/// anything else stays.
///
/// # Errors
/// As [`wipe`].
pub fn remove_cell(cell: &Cell) -> Result<WipeReport, WipeError> {
    let (report, _alone) = wipe_alone(cell)?;
    let ours = [
        cell.config_copy(),
        cell.janitor_lock_file(),
        cell.lock_file(),
    ];
    for path in ours.into_iter().chain(cell.life_files()) {
        remove_file(&path).map_err(|source| WipeError::File { path, source })?;
    }
    let path = cell.incidents_dir();
    remove_folder(&path).map_err(|source| WipeError::File { path, source })?;
    // Not empty: somebody else's files; they are not ours to remove.
    let _ = fs::remove_dir(cell.runtime_dir());
    if let Some(base) = cell.own_base() {
        // Not empty: other cells. One that is just being made makes it again.
        let _ = fs::remove_dir(base);
    }
    Ok(report)
}

fn wipe_alone(cell: &Cell) -> Result<(WipeReport, impl Drop), WipeError> {
    cell.make_folders()?;
    let announced = cell.announced_all()?;
    refuse_living(cell, &announced)?;
    let alone = lock::exclusive_within(&cell.lock_file(), DYING).map_err(|error| match error {
        LockError::Held { path } => WipeError::InUse {
            cell: cell.name().to_owned(),
            lock: path,
        },
        other => WipeError::Lock(other),
    })?;
    // Whoever came in between has the lock, and then we do not.
    refuse_living(cell, &cell.announced_all()?)?;
    let mut report = WipeReport {
        announcements: announced.len(),
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
    Ok((report, alone))
}

fn refuse_living(cell: &Cell, announced: &[Announcement]) -> Result<(), WipeError> {
    // Whoever may live counts as living.
    match announced
        .iter()
        .find(|announcement| !announcement.liveness().is_dead())
    {
        None => Ok(()),
        Some(living) => Err(WipeError::Living {
            cell: cell.name().to_owned(),
            role: living.role,
            label: living.label.clone(),
            pid: living.pid,
        }),
    }
}

/// Writes a file that only its owner may read.
pub(crate) fn write_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut options = fs::OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(0o600);
    options.open(path)?.write_all(bytes)
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
