//! The files of a cell in `/dev/shm`, in use or left behind by dead processes. Runs on any thread that is not real-time.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::cell::Cell;
use crate::shm_space::{ForeignFile, below_prefix};

impl Cell {
    /// Returns everything of this cell in `/dev/shm`, in use or left behind: its shared-memory files, and the files in
    /// iceoryx2's folder (the folder itself if it is empty). In a cell without processes all of it is left behind.
    ///
    /// # Errors
    /// Returns an error if `/dev/shm` cannot be read.
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

    /// Returns the shared-memory files of this cell that belong to this user.
    pub(crate) fn shared_memory(&self) -> io::Result<Vec<PathBuf>> {
        let root = self.iox_root();
        let (mut ours, _) = below_prefix(self.prefix())?;
        ours.retain(|path| *path != root);
        Ok(ours)
    }

    /// Returns the files of other users under this cell's prefix, with their owners. They are not part of the cell and
    /// we may not remove them.
    ///
    /// # Errors
    /// Returns an error if `/dev/shm` cannot be read.
    pub fn foreign(&self) -> io::Result<Vec<ForeignFile>> {
        Ok(below_prefix(self.prefix())?.1)
    }
}

/// Returns all files below a folder, or `None` if the folder does not exist.
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
