//! Why a cell cannot be looked up or created, in words that name the remedy. Plain data.

use std::io;
use std::path::PathBuf;

/// `sun_path` of a Unix socket address holds 108 bytes including the terminating zero (unix(7)).
pub(crate) const SOCKET_PATH_MAX: usize = 107;

/// Error while looking up or creating a cell.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// The name does not match `[a-z0-9][a-z0-9_-]{0,31}`.
    #[error(
        "invalid cell name `{name}`: use 1 to 32 of a-z 0-9 _ -, beginning with a letter or digit"
    )]
    BadName {
        /// The given name.
        name: String,
    },
    /// The path of the socket in this folder is longer than the system allows.
    #[error(
        "{path} has {size} bytes, a Unix socket's path at most {SOCKET_PATH_MAX}: set RCC_RUNTIME_DIR to a shorter folder"
    )]
    PathTooLong {
        /// Path of the socket.
        path: PathBuf,
        /// Its length, bytes.
        size: usize,
    },
    /// The folder cannot be created or inspected.
    #[error("{path}: {source}; set RCC_RUNTIME_DIR to a folder you may write to")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
    /// The state folder cannot be created, or is not ours.
    #[error(
        "{path}: {source}; event log, incidents and logs are kept there: set RCC_STATE_DIR, or `recorder: {{folder: …}}` in \
         the cell's configuration, to a folder you may write to"
    )]
    State {
        /// The folder.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
    /// The cell was removed and created again with another prefix after it was looked up.
    #[error("cell `{cell}` was recreated meanwhile: try again")]
    MadeAnew {
        /// The cell.
        cell: String,
    },
    /// The folder exists but belongs to another user.
    #[error(
        "{path} belongs to {}, you are {}: ask that user or root to remove it, use another cell name (--cell), or set RCC_RUNTIME_DIR to a folder of your own",
        person(*owner), person(*uid)
    )]
    NotOurs {
        /// The folder.
        path: PathBuf,
        /// User id of the owner.
        owner: u32,
        /// User id of this process.
        uid: u32,
    },
    /// Other users may write to the folder and could replace our files.
    #[error(
        "{path} can be written by others (mode {mode:04o}): `chmod go-w {path}`, or set RCC_RUNTIME_DIR to a folder of your own"
    )]
    Writable {
        /// The folder.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
}

impl CellError {
    /// Returns true for a folder that disappeared between creation and inspection.
    pub(crate) fn is_passing(&self) -> bool {
        use io::ErrorKind::{AlreadyExists, NotFound};
        matches!(self, CellError::Folder { source, .. } if matches!(source.kind(), NotFound | AlreadyExists))
    }
}

/// Describes a user for people: `user rcc (uid 998)`.
#[must_use]
pub fn person(uid: u32) -> String {
    let found = nix::unistd::User::from_uid(nix::unistd::Uid::from_raw(uid));
    match found.ok().flatten() {
        Some(user) => format!("user {} (uid {uid})", user.name),
        None => format!("a user without a name (uid {uid})"),
    }
}
