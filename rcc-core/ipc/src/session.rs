//! This process in a cell: the one iceoryx2 node through which all its services are created and opened.
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

use crate::cell::{Cell, CellError};
use crate::clean;
use crate::lock::{self, LockError};
use crate::process_instance::ProcessInstance;
use crate::shm_space::{self, OutOfSharedMemory, SHM};

/// Shared memory that a node itself needs, with the management segment of the first node of a cell.
const NODE_ROOM: u64 = 1 << 20;
/// How long a service half-created by another process is waited for.
const CREATION_TIMEOUT: Duration = Duration::from_millis(100);
/// How long joining waits for a wipe to end.
const WIPE_WAIT: Duration = Duration::from_secs(5);
/// Longest label.
const LABEL_LENGTH_MAX: usize = 64;

/// What a process does in its cell.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Text to plans; the REST server.
    Loader,
    /// The cycle.
    Executor,
    /// One device.
    Driver,
    /// Reads streams.
    Monitor,
    /// A command a person typed.
    Cli,
}

impl Role {
    /// Its name in file and service names.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Role::Loader => "loader",
            Role::Executor => "executor",
            Role::Driver => "driver",
            Role::Monitor => "monitor",
            Role::Cli => "cli",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.as_str())
    }
}

/// Words of iceoryx2 about what went wrong.
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

/// Why this process is not in the cell.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// Too little shared memory.
    #[error(transparent)]
    OutOfSharedMemory(#[from] OutOfSharedMemory),
    /// A label of another form than `[A-Za-z0-9][A-Za-z0-9_.-]{0,63}`.
    #[error(
        "'{label}' cannot be a label: use 1 to 64 of A-Z a-z 0-9 _ . -, beginning with a letter or digit"
    )]
    BadLabel {
        /// What was given.
        label: String,
    },
    /// The runtime folder cannot be used.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The start time of this process cannot be read.
    #[error(
        "this process cannot tell itself from others: {0}; it needs /proc and a free file descriptor"
    )]
    ProcessInstance(std::io::Error),
    /// The cell is being wiped, and that takes too long.
    #[error("cell '{cell}': {source}")]
    Lock {
        /// The cell.
        cell: String,
        /// What held it up.
        source: LockError,
    },
    /// The folder's path is too long, or holds bytes that iceoryx2 does not take.
    #[error("'{path}' cannot hold shared files: use a shorter, plain path (RCC_RUNTIME_DIR)")]
    BadPath {
        /// The path.
        path: String,
    },
    /// iceoryx2 could not make its node.
    #[error(
        "cell '{cell}' cannot be joined: {cause}; stop its processes and run rcc-janitor --wipe"
    )]
    Node {
        /// The cell.
        cell: String,
        /// What iceoryx2 said.
        cause: IceoryxError,
    },
}

/// Proof, for the other processes, that this one still uses the cell: nobody wipes it meanwhile.
pub(crate) type Membership = Arc<Flock<File>>;

/// This process in a cell. Everything made through it keeps it in the cell until dropped.
pub struct Session {
    cell: Cell,
    role: Role,
    label: String,
    instance: ProcessInstance,
    serial: u64,
    node: Node<ipc_threadsafe::Service>,
    // Last, so that it is released after the node is gone.
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
    /// Brings this process into the cell. `label` tells processes of one role apart (a driver's is its device's name).
    ///
    /// # Errors
    /// Too little shared memory, a folder that cannot be used, or a node that iceoryx2 cannot make.
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
            // Relaxed: only different numbers are wanted.
            serial: SERIAL.fetch_add(1, Ordering::Relaxed),
            node,
            membership: Arc::new(membership),
        })
    }

    /// The cell it is in.
    #[must_use]
    pub fn cell(&self) -> &Cell {
        &self.cell
    }

    /// What this process does there.
    #[must_use]
    pub fn role(&self) -> Role {
        self.role
    }

    /// Its label.
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// This process' life.
    #[must_use]
    pub fn instance(&self) -> ProcessInstance {
        self.instance
    }

    /// A number that no other life of a process has; 16 hexadecimal digits in names.
    #[must_use]
    pub fn incarnation(&self) -> u64 {
        self.instance.incarnation()
    }

    pub(crate) fn node(&self) -> &Node<ipc_threadsafe::Service> {
        &self.node
    }

    pub(crate) fn membership(&self) -> Membership {
        Arc::clone(&self.membership)
    }

    /// The full name of this session's service `name`, or nothing when it is too long or has odd characters.
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

/// The life of the process that created the service, as its name tells.
pub(crate) fn owner_of(service: &str) -> Option<ProcessInstance> {
    let digits = service.split('/').nth(1)?.split('.').next()?;
    u64::from_str_radix(digits, 16)
        .ok()
        .map(ProcessInstance::from_incarnation)
}

/// Takes the shared lock of the cell and makes a node. The first process of a cell may have died while it made what
/// all share; then nobody can enter until that is wiped, which is done here when nobody else is in.
pub(crate) fn enter(
    cell: &Cell,
) -> Result<(Flock<File>, Node<ipc_threadsafe::Service>), SessionError> {
    match enter_as_it_is(cell) {
        Err(SessionError::Node { .. }) if clean::wipe(cell).is_ok() => enter_as_it_is(cell),
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
    // Again: a wipe may have ended between the two.
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

/// The two files whose names are known before they are made may be somebody else's: that would be taken for the cell's
/// own. While a process of the cell lives they are there and ours; without one the cell takes another prefix at the next
/// look. All other names have numbers that nobody foresees, so what lies beside them keeps nobody out.
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

/// The segment that all nodes of a cell share (a counter of nodes) is the one file that iceoryx2 0.10.0 opens to
/// everybody (mode 0666, by fchmod, which no umask changes): it gets the mode of the others, and is refused when
/// somebody else made it.
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

/// Everything that the cell's processes must agree on; all cleaning is left to the janitor.
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
