//! Ids that no earlier executor of the cell has given: a client that still holds the id of a command, rule or lease of a
//! dead executor must never start, cancel or renew what somebody else has made since. Intake thread.
//!
//! A file in the cell's runtime folder holds a number that no id has reached. It is raised by blocks before an id beyond
//! it is told to anybody, so that it is written rarely. The ids of a cell that is started anew begin with 1.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rcc_ipc::Cell;
use rcc_os::file::{self, Readers};
use thiserror::Error;
use tracing::warn;

/// Ids between two writes of the file, and at most so many are skipped when an executor is restarted.
const BLOCK: u64 = 1000;

/// The ids cannot be continued.
#[derive(Debug, Error)]
pub enum IdError {
    /// The file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file holds something else.
    #[error("{path}: not a number: end the cell with `rcc-cli down`, or remove the file when no client of the cell runs", path = path.display())]
    Content {
        /// The file.
        path: PathBuf,
    },
}

/// The ids that this executor may give.
#[derive(Debug)]
pub struct IdBlocks {
    path: PathBuf,
    /// The number in the file: every id that was told to anybody is below it.
    bound: u64,
}

impl IdBlocks {
    /// Reserves the first block; returns it with the first id.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or written, or holds no number.
    pub fn claim(cell: &Cell) -> Result<(IdBlocks, u64), IdError> {
        Self::claim_in(cell.next_id_file())
    }

    fn claim_in(path: PathBuf) -> Result<(IdBlocks, u64), IdError> {
        let first = match fs::read_to_string(&path) {
            Ok(text) => text.trim().parse::<u64>().ok().filter(|first| *first > 0),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Some(1),
            Err(source) => return Err(IdError::File { path, source }),
        };
        let Some(first) = first else {
            return Err(IdError::Content { path });
        };
        let bound = first.saturating_add(BLOCK);
        match write(&path, bound) {
            Ok(()) => Ok((IdBlocks { path, bound }, first)),
            Err(source) => Err(IdError::File { path, source }),
        }
    }

    /// Call it with each new id before it is told to anybody.
    pub fn cover(&mut self, id: u64) {
        if id < self.bound {
            return;
        }
        let bound = id.saturating_add(BLOCK);
        match write(&self.path, bound) {
            Ok(()) => self.bound = bound,
            Err(error) => warn!(
                "{}: {error}: should this executor be restarted, ids from {} on may be given twice",
                self.path.display(),
                self.bound
            ),
        }
    }
}

fn write(path: &Path, bound: u64) -> io::Result<()> {
    file::replace(path, format!("{bound}\n").as_bytes(), Readers::Anybody)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_id_is_given_twice_whenever_the_executor_dies() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("next-id");
        let mut told = 0;
        for ids in [1, BLOCK - 1, BLOCK, 3 * BLOCK + 1] {
            let (mut blocks, first) = IdBlocks::claim_in(path.clone()).unwrap();
            assert!(first > told, "{first} after {told}");
            assert!(first - told <= BLOCK, "{first} after {told}");
            for id in first..first + ids {
                blocks.cover(id);
                told = id;
            }
        }
    }

    #[test]
    fn a_file_that_holds_no_number_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        for text in ["", "0", "-1", "many"] {
            let path = folder.path().join("next-id");
            fs::write(&path, text).unwrap();
            let error = IdBlocks::claim_in(path).unwrap_err().to_string();
            assert!(error.contains("next-id: not a number"), "{error}");
        }
    }
}
