//! Files whose lock tells that a process lives: the kernel releases it at any death, between any two instructions.
//! Run by threads that are not real-time.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};

/// How often a lock that somebody else holds is tried again.
const RETRY: Duration = Duration::from_millis(5);

/// Why there is no lock.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Somebody else holds it.
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
        /// What the system said.
        source: io::Error,
    },
}

/// Shares the lock with any number of others, waiting at most `patience` for an exclusive holder.
pub(crate) fn shared_within(path: &Path, patience: Duration) -> Result<Flock<File>, LockError> {
    within(path, FlockArg::LockSharedNonblock, patience)
}

/// The lock for us alone, waiting at most `patience` for it.
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

/// The lock for us alone, or at once [`LockError::Held`].
pub(crate) fn exclusive(path: &Path) -> Result<Flock<File>, LockError> {
    attempt(path, FlockArg::LockExclusiveNonblock)
}

/// Locks the file that `path` names. A holder may remove the file, so after locking we look whether the name still
/// leads to the file we locked; each retry means that somebody else just removed one.
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
