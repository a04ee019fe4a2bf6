//! Lock files that prove that a process lives: the kernel releases the lock whenever the process dies. Used by threads
//! that are not real-time.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};

/// Interval between attempts to take a lock that another process holds.
const RETRY: Duration = Duration::from_millis(5);

/// Error while taking a lock.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process holds the lock.
    #[error("{path} is locked by another process")]
    Held {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be opened or locked.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
}

/// Takes the lock shared, waiting at most `patience` for an exclusive holder.
pub(crate) fn shared_within(path: &Path, patience: Duration) -> Result<Flock<File>, LockError> {
    within(path, FlockArg::LockSharedNonblock, patience)
}

/// Takes the lock exclusively, waiting at most `patience`.
pub(crate) fn exclusive_within(path: &Path, patience: Duration) -> Result<Flock<File>, LockError> {
    within(path, FlockArg::LockExclusiveNonblock, patience)
}

fn within(path: &Path, kind: FlockArg, patience: Duration) -> Result<Flock<File>, LockError> {
    let limit = Instant::now() + patience;
    loop {
        match attempt(path, kind) {
            Err(LockError::Held { .. }) if Instant::now() < limit => std::thread::sleep(RETRY),
            result => return result,
        }
    }
}

/// Takes the lock exclusively, or returns [`LockError::Held`] at once.
pub(crate) fn exclusive(path: &Path) -> Result<Flock<File>, LockError> {
    attempt(path, FlockArg::LockExclusiveNonblock)
}

/// Locks the file at `path`. A holder may remove the file, so after locking check that the path still leads to the
/// locked file; each retry means that another process just removed one.
fn attempt(path: &Path, kind: FlockArg) -> Result<Flock<File>, LockError> {
    let failed = |source| LockError::File {
        path: path.to_owned(),
        source,
    };
    loop {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(path)
            .map_err(failed)?;
        let inode = file.metadata().map_err(failed)?.ino();
        let held = match Flock::lock(file, kind) {
            Ok(held) => held,
            Err((_, Errno::EAGAIN)) => {
                return Err(LockError::Held {
                    path: path.to_owned(),
                });
            }
            Err((_, error)) => return Err(failed(error.into())),
        };
        match std::fs::metadata(path) {
            Ok(found) if found.ino() == inode => return Ok(held),
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(failed(error)),
        }
    }
}

/// Returns true if `path` is the locked file, and not a new file in its place.
pub(crate) fn is_locked_file(path: &Path, locked: &File) -> bool {
    let of =
        |found: io::Result<std::fs::Metadata>| found.ok().map(|found| (found.dev(), found.ino()));
    let named = of(std::fs::metadata(path));
    named.is_some() && named == of(locked.metadata())
}
