//! Membership of this process in a cell: the one iceoryx2 node through which all its services are created and opened.
//! Joined once by the main thread; shared by its helper threads, never by the real-time thread.

use std::fmt;
use std::fs::File;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use iceoryx2::prelude::{
    Config, FileName, LogLevel, Node, NodeBuilder, Path, SemanticString, ServiceName,
    SignalHandlingMode, ipc_threadsafe, set_log_level,
};
use nix::fcntl::Flock;
use rcc_os::process_instance::ProcessInstance;
use rcc_protocol::{Announcement, Role};

use crate::cell::{Cell, CellError};
use crate::lock::{self, LockError};
use crate::shm_space::{self, OutOfSharedMemory, SHM};
use crate::wipe;

/// Shared memory of a node, including the management segment that the first node of a cell creates, bytes.
const NODE_ROOM: u64 = 1 << 20;
/// How long to wait for a service that another process is creating.
const CREATION_TIMEOUT: Duration = Duration::from_millis(100);
/// How long joining waits for a wipe to finish.
const WIPE_WAIT: Duration = Duration::from_secs(5);
/// Maximum length of a label, characters.
const LABEL_LENGTH_MAX: usize = 64;

/// Error description from iceoryx2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IceoryxError(pub(crate) String);

impl IceoryxError {
    pub(crate) fn of(error: impl fmt::Debug) -> IceoryxError {
        IceoryxError(format!("{error:?}"))
    }
}

impl fmt::Display for IceoryxError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "iceoryx2: {}", self.0)
    }
}

/// Error while joining a cell.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// Not enough shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// The label does not match `[A-Za-z0-9][A-Za-z0-9_.-]{0,63}`.
    #[error(
        "invalid label `{label}`: use 1 to 64 of A-Z a-z 0-9 _ . -, beginning with a letter or digit"
    )]
    BadLabel {
        /// The given label.
        label: String,
    },
    /// The runtime folder cannot be used.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The start time of this process cannot be read.
    #[error(
        "cannot read the start time of this process: {0}; /proc and a free file descriptor are needed"
    )]
    ProcessInstance(std::io::Error),
    /// The cell is being wiped, and that takes too long.
    #[error("cell `{cell}`: {source}")]
    Lock {
        /// The cell.
        cell: String,
        /// The lock that is held.
        source: LockError,
    },
    /// The path of the folder is too long, or has bytes that iceoryx2 does not accept.
    #[error(
        "iceoryx2 cannot use the path `{path}`: use a shorter path of plain characters (RCC_RUNTIME_DIR)"
    )]
    BadPath {
        /// The path.
        path: String,
    },
    /// iceoryx2 could not create the node.
    #[error("cannot join cell `{cell}`: {cause}; stop its processes and run rcc-janitor --wipe")]
    Node {
        /// The cell.
        cell: String,
        /// Error from iceoryx2.
        cause: IceoryxError,
    },
}

/// Shared lock that tells other processes that this one still uses the cell; it prevents a wipe.
pub(crate) type Membership = Arc<Flock<File>>;

/// This process in a cell. Everything created through it keeps the process in the cell until it is dropped.
pub struct Session {
    cell: Cell,
    role: Role,
    label: String,
    instance: ProcessInstance,
    serial: u64,
    node: Node<ipc_threadsafe::Service>,
    // Last field, so that it is released after the node is gone.
    membership: Membership,
}

impl fmt::Debug for Session {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "Session({}, {}-{})",
            self.cell.name(),
            self.role,
            self.label
        )
    }
}

impl Session {
    /// Joins the cell. `label` distinguishes processes of one role (for a driver, the name of its device).
    ///
    /// # Errors
    /// Returns an error if shared memory is short, if a folder cannot be used, or if iceoryx2 cannot create a node.
    pub fn join(cell: &Cell, role: Role, label: &str) -> Result<Session, SessionError> {
        static SERIAL: AtomicU64 = AtomicU64::new(0);
        check_label(label)?;
        shm_space::require(NODE_ROOM)?;
        set_log_level(LogLevel::Fatal);
        let (membership, node) = enter(cell)?;
        Ok(Session {
            cell: cell.clone(),
            role,
            label: label.to_owned(),
            instance: ProcessInstance::current().map_err(SessionError::ProcessInstance)?,
            // Relaxed: the numbers only need to differ.
            serial: SERIAL.fetch_add(1, Ordering::Relaxed),
            node,
            membership: Arc::new(membership),
        })
    }

    /// Returns the cell.
    #[must_use]
    pub fn cell(&self) -> &Cell {
        &self.cell
    }

    /// Returns the role of this process.
    #[must_use]
    pub fn role(&self) -> Role {
        self.role
    }

    /// Returns the label.
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Returns the instance of this process.
    #[must_use]
    pub fn instance(&self) -> ProcessInstance {
        self.instance
    }

    /// Returns the incarnation number of this process, which no other process instance has; 16 hexadecimal digits in
    /// names.
    #[must_use]
    pub fn incarnation(&self) -> u64 {
        self.instance.incarnation()
    }

    /// Returns the announcement of this process, without services.
    #[must_use]
    pub fn announcement(&self) -> Announcement {
        Announcement::new(self.role, &self.label, self.instance)
    }

    pub(crate) fn node(&self) -> &Node<ipc_threadsafe::Service> {
        &self.node
    }

    pub(crate) fn membership(&self) -> Membership {
        Arc::clone(&self.membership)
    }

    /// Returns the full name of this session's service `name`, or `None` if it is too long or has unsupported
    /// characters.
    pub(crate) fn service_name(&self, name: &str) -> Option<ServiceName> {
        let plain = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_graphic());
        let full = format!(
            "{}-{}/{:016x}.{}/{name}",
            self.role,
            self.label,
            self.incarnation(),
            self.serial
        );
        plain.then(|| ServiceName::new(&full).ok()).flatten()
    }
}

/// Returns the process instance that created the service, parsed from its name.
pub(crate) fn owner_of(service: &str) -> Option<ProcessInstance> {
    let digits = service.split('/').nth(1)?.split('.').next()?;
    u64::from_str_radix(digits, 16)
        .ok()
        .map(ProcessInstance::from_incarnation)
}

/// Takes the shared lock of the cell and creates a node. If the first process of a cell died while it created what all
/// share, no process can join until that is wiped, which this does when no other process is in the cell.
pub(crate) fn enter(
    cell: &Cell,
) -> Result<(Flock<File>, Node<ipc_threadsafe::Service>), SessionError> {
    match enter_as_it_is(cell) {
        Err(SessionError::Node { .. }) if wipe::wipe(cell).is_ok() => enter_as_it_is(cell),
        result => result,
    }
}

fn enter_as_it_is(
    cell: &Cell,
) -> Result<(Flock<File>, Node<ipc_threadsafe::Service>), SessionError> {
    cell.make_folders()?;
    let membership =
        lock::shared_within(&cell.lock_file(), WIPE_WAIT).map_err(|source| SessionError::Lock {
            cell: cell.name().to_owned(),
            source,
        })?;
    // Again: a wipe may have finished between the two.
    cell.make_folders()?;
    cell.require_same_prefix()?;
    refuse_foreign(cell)?;
    cell.make_iox_root()?;
    let node = NodeBuilder::new()
        .config(&config(cell)?)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc_threadsafe::Service>()
        .map_err(|error| SessionError::Node {
            cell: cell.name().to_owned(),
            cause: IceoryxError::of(error),
        })?;
    close_common_segment(cell)?;
    Ok((membership, node))
}

/// Refuses the cell if another user owns one of the two files whose names are predictable, because they would be taken
/// for the cell's own. While a process of the cell lives, the files exist and are ours; otherwise the cell takes
/// another prefix the next time it is looked up. All other names contain unpredictable numbers, so other foreign files
/// do no harm.
fn refuse_foreign(cell: &Cell) -> Result<(), SessionError> {
    let listed = |source| CellError::Folder {
        path: SHM.into(),
        source,
    };
    let foreign = cell.foreign().map_err(listed)?;
    if foreign.is_empty() {
        return Ok(());
    }
    let ours = cell.shared_memory().map_err(listed)?;
    let (root, is_made) = (cell.iox_root(), ours.iter().any(|path| is_common(path)));
    let mut blocking = foreign
        .into_iter()
        .filter(|file| file.path == root || !is_made && is_common(&file.path));
    match blocking.next() {
        None => Ok(()),
        Some(first) => Err(SessionError::from(CellError::NotOurs {
            path: first.path,
            owner: first.owner,
            uid: nix::unistd::getuid().as_raw(),
        })),
    }
}

fn is_common(path: &std::path::Path) -> bool {
    path.extension().is_some_and(|kind| kind == "global_mgmt")
}

/// Restricts the mode of the segment that all nodes of a cell share (a counter of nodes). It is the only file that
/// iceoryx2 0.10.0 opens to everybody (mode 0666, by fchmod, which ignores the umask). Refuses a segment that another
/// user created.
fn close_common_segment(cell: &Cell) -> Result<(), SessionError> {
    refuse_foreign(cell)?;
    let failed = |path: &std::path::Path, source| {
        SessionError::from(CellError::Folder {
            path: path.to_owned(),
            source,
        })
    };
    let listed = |source| failed(std::path::Path::new(SHM), source);
    let files = cell.shared_memory().map_err(listed)?;
    for path in files.iter().filter(|path| is_common(path)) {
        let found = std::fs::symlink_metadata(path).map_err(|source| failed(path, source))?;
        if found.mode() & 0o077 != 0 {
            let private = std::fs::Permissions::from_mode(0o600);
            std::fs::set_permissions(path, private).map_err(|source| failed(path, source))?;
        }
    }
    Ok(())
}

/// Returns the iceoryx2 settings that all processes of the cell must share; all cleaning is left to the janitor.
pub(crate) fn config(cell: &Cell) -> Result<Config, SessionError> {
    let root = cell.iox_root();
    let bad_path = || SessionError::BadPath {
        path: root.display().to_string(),
    };
    let mut config = Config::default();
    config.global.prefix = FileName::new(cell.prefix().as_bytes()).map_err(|_| bad_path())?;
    let path = Path::new(root.as_os_str().as_encoded_bytes()).map_err(|_| bad_path())?;
    config.global.set_root_path(&path);
    config.global.creation_timeout = CREATION_TIMEOUT;
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    Ok(config)
}

fn check_label(label: &str) -> Result<(), SessionError> {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'.' | b'-');
    if label.len() <= LABEL_LENGTH_MAX
        && label.bytes().all(plain)
        && label.starts_with(|first: char| first.is_ascii_alphanumeric())
    {
        return Ok(());
    }
    Err(SessionError::BadLabel {
        label: label.to_owned(),
    })
}
