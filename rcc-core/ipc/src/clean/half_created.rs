//! Shared-memory files that are still empty: their process died between creating and sizing them, or is about to size
//! them. Runs on threads of the janitor. Uses no iceoryx2, creates nothing, and does not depend on the wall clock,
//! which may be set.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rcc_os::clock::monotonic_ns;

use super::CleanError;
use crate::cell::Cell;
use crate::reap;
use crate::shm_space::SHM;
use crate::wipe::remove_file;

/// A shared-memory file that has been empty for this long was left by a process that died between creating and sizing
/// it.
pub const HALF_CREATED_AFTER: Duration = Duration::from_millis(300);

/// Removes this cell's empty shared-memory files; returns how many. A file whose name identifies a dead process is
/// removed at once. For other files it waits [`HALF_CREATED_AFTER`] and removes those that are still empty. iceoryx2
/// 0.10.0 waits for such a file forever, so this unblocks threads that hang there. May be called at any time by any
/// thread that may sleep.
///
/// # Errors
/// Returns an error if `/dev/shm` cannot be read, or if a file cannot be removed.
pub fn remove_half_created(cell: &Cell) -> Result<usize, CleanError> {
    let mut watch = EmptyFileWatch::default();
    let removed = watch.sweep(cell)?;
    if !watch.is_waiting() {
        return Ok(removed);
    }
    std::thread::sleep(HALF_CREATED_AFTER);
    Ok(removed + watch.sweep(cell)?)
}

/// Empty files with the time (monotonic clock, ns) at which each was first seen. A file recreated under the same name
/// has another inode. File dates are not used: they follow the wall clock, which may have been set meanwhile.
#[derive(Debug, Default)]
pub(crate) struct EmptyFileWatch(BTreeMap<(PathBuf, u64), u64>);

impl EmptyFileWatch {
    /// Scans once; removes the files that are old enough or that a dead process created.
    pub(crate) fn sweep(&mut self, cell: &Cell) -> Result<usize, CleanError> {
        self.sweep_at(cell, monotonic_ns())
    }

    /// Returns true while there is an empty file that is not old enough.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.0.is_empty()
    }

    fn sweep_at(&mut self, cell: &Cell, now_ns: u64) -> Result<usize, CleanError> {
        let failed = |path: &Path, source| CleanError::File {
            path: path.to_owned(),
            source,
        };
        let files = cell.shared_memory();
        let files = files.map_err(|source| failed(Path::new(SHM), source))?;
        let mut removed = 0;
        let mut still = BTreeMap::new();
        for path in files {
            // The owner removed it meanwhile.
            let Ok(found) = fs::symlink_metadata(&path) else {
                continue;
            };
            if found.len() != 0 {
                continue;
            }
            let key = (path, found.ino());
            let since_ns = self.0.get(&key).copied().unwrap_or(now_ns);
            let is_old =
                u128::from(now_ns.saturating_sub(since_ns)) >= HALF_CREATED_AFTER.as_nanos();
            if is_old || reap::is_orphaned(&key.0) {
                let gone = remove_file(&key.0).map_err(|source| failed(&key.0, source))?;
                removed += usize::from(gone);
            } else {
                still.insert(key, since_ns);
            }
        }
        self.0 = still;
        Ok(removed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{File, FileTimes};
    use std::io;
    use std::time::SystemTime;

    use rcc_testing::TempDir;

    struct TestCell {
        cell: Cell,
        _folder: TempDir,
    }

    impl TestCell {
        fn new() -> TestCell {
            let folder = rcc_testing::folder();
            let cell = Cell::at("half", folder.path());
            TestCell {
                cell: cell.unwrap_or_else(|error| panic!("{error}")),
                _folder: folder,
            }
        }

        fn plant(&self, name: &str, made: SystemTime) -> io::Result<PathBuf> {
            let path = Path::new(SHM).join(format!("{}{name}", self.cell.prefix()));
            File::create(&path)?.set_times(FileTimes::new().set_modified(made))?;
            Ok(path)
        }
    }

    impl Drop for TestCell {
        fn drop(&mut self) {
            for path in self.cell.leftovers().unwrap_or_default() {
                let _ = fs::remove_file(path);
            }
        }
    }

    #[test]
    fn a_file_that_stays_empty_is_removed_whatever_its_date()
    -> Result<(), Box<dyn std::error::Error>> {
        let cell = TestCell::new();
        let hour = Duration::from_secs(3600);
        let now = SystemTime::now();
        for (name, made) in [("past", now - hour), ("now", now), ("future", now + hour)] {
            let path = cell.plant(name, made)?;
            let mut watch = EmptyFileWatch::default();
            let begun = 1_000_000_000;
            let after = HALF_CREATED_AFTER.as_nanos() as u64;
            assert_eq!(watch.sweep_at(&cell.cell, begun)?, 0, "{name}");
            assert_eq!(watch.sweep_at(&cell.cell, begun + after - 1)?, 0, "{name}");
            assert!(path.exists() && watch.is_waiting());
            assert_eq!(watch.sweep_at(&cell.cell, begun + after)?, 1, "{name}");
            assert!(!path.exists() && !watch.is_waiting());
        }
        Ok(())
    }

    #[test]
    fn a_file_with_content_or_recreated_meanwhile_stays() -> Result<(), Box<dyn std::error::Error>>
    {
        let cell = TestCell::new();
        let now = SystemTime::now();
        let path = cell.plant("file", now)?;
        let keep = File::open(&path)?;
        let mut watch = EmptyFileWatch::default();
        watch.sweep_at(&cell.cell, 1)?;
        fs::remove_file(&path)?;
        cell.plant("file", now)?;
        assert_eq!(watch.sweep_at(&cell.cell, u64::MAX / 2)?, 0, "another file");
        drop(keep);
        fs::write(&path, "x")?;
        assert_eq!(watch.sweep_at(&cell.cell, u64::MAX)?, 0);
        assert!(path.exists() && !watch.is_waiting());
        Ok(())
    }
}
