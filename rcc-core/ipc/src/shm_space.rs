//! Free room in `/dev/shm`, looked at before shared memory is made: iceoryx2 does not reserve, and a full file system
//! would end the process by SIGBUS at the first touch. Run by the threads that create services.

use std::path::Path;

/// Where iceoryx2 puts shared memory.
pub(crate) const SHM: &str = "/dev/shm";

/// Kept free beside what is asked for, because others create at the same time.
const RESERVE: u64 = 1 << 20;

/// Too little room for what was to be created.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{path} has {have} bytes free and {need} are needed: remove old files there, or enlarge it (mount -o remount,size=)"
)]
pub struct OutOfSharedMemory {
    /// Bytes needed.
    pub need: u64,
    /// Bytes free.
    pub have: u64,
    /// The file system.
    pub path: String,
}

/// Checks that `need` bytes of shared memory can be created now.
///
/// # Errors
/// [`OutOfSharedMemory`] when fewer bytes, and a small reserve, are free. A file system that cannot be asked counts as roomy.
pub fn require(need: u64) -> Result<(), OutOfSharedMemory> {
    check(Path::new(SHM), need)
}

/// Bytes of shared memory that can still be created; nothing if the file system cannot be asked.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_there_is_is_refused_with_figures() {
        assert_eq!(require(0), Ok(()));
        let refused = require(u64::MAX / 2);
        assert!(matches!(refused, Err(OutOfSharedMemory { need, have, .. }) if have < need));
    }
}
