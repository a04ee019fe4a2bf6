//! `/dev/shm`: its files by prefix, and its free space, which is checked before shared memory is created: iceoryx2 does not
//! reserve the space, and on a full file system the first access would end the process with SIGBUS. Used by the threads
//! that create services, and by those that clean up.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Where iceoryx2 puts shared memory.
pub(crate) const SHM: &str = "/dev/shm";

/// Space kept free beyond each request, because other processes create shared memory at the same time, bytes.
const RESERVE: u64 = 1 << 20;

/// Not enough free space for what was to be created.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{path} has {have} bytes free, {need} are needed: remove old files there, or enlarge it (mount -o remount,size=)"
)]
pub struct OutOfSharedMemory {
    /// Bytes needed, including the reserve.
    pub need: u64,
    /// Bytes free.
    pub have: u64,
    /// Path of the file system.
    pub path: String,
}

/// Checks that `need` bytes of shared memory can be created now.
///
/// # Errors
/// Returns [`OutOfSharedMemory`] if less than `need` and a small reserve is free. A file system that cannot be queried
/// counts as large enough.
pub fn require(need: u64) -> Result<(), OutOfSharedMemory> {
    check(Path::new(SHM), need)
}

/// Returns the free shared memory, bytes; `None` if the file system cannot be queried.
pub(crate) fn free() -> Option<u64> {
    free_in(Path::new(SHM))
}

fn free_in(path: &Path) -> Option<u64> {
    let found = nix::sys::statvfs::statvfs(path).ok()?;
    let blocks = found.blocks_available();
    Some(blocks.saturating_mul(found.fragment_size()))
}

fn check(path: &Path, need: u64) -> Result<(), OutOfSharedMemory> {
    let Some(have) = free_in(path) else {
        return Ok(());
    };
    let need = need.saturating_add(RESERVE);
    if have < need {
        return Err(OutOfSharedMemory {
            need,
            have,
            path: path.display().to_string(),
        });
    }
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_beyond_the_free_space_is_refused_with_figures() {
        assert_eq!(require(0), Ok(()));
        let refused = require(u64::MAX / 2);
        assert!(matches!(refused, Err(OutOfSharedMemory { need, have, .. }) if have < need));
    }
}
