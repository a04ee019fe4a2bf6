//! The announcement files of a cell: each process writes one, under a lock. Read and written by threads that are not
//! real-time.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use nix::fcntl::Flock;
use rcc_os::file::{self, Readers};
use rcc_protocol::{Announcement, Role};

use crate::cell::{Cell, CellError};
use crate::lock::{self, LockError};

/// Maximum size of an announcement file, bytes.
const BYTES_MAX: u64 = 1 << 20;

/// Error while making or reading an announcement.
#[derive(Debug, thiserror::Error)]
pub enum AnnounceError {
    /// A live process already has this role and label in the cell.
    #[error(
        "{role} `{label}` is already running in cell `{cell}` (pid {pid}): stop it, or use another cell"
    )]
    AlreadyRunning {
        /// The role.
        role: Role,
        /// The label.
        label: String,
        /// The cell.
        cell: String,
        /// Process id of the running process; 0 if it has locked its announcement but not written it yet.
        pid: u32,
    },
    /// The file is not an announcement.
    #[error("{path} is not an announcement ({source}): remove it")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Parse error.
        source: serde_json::Error,
    },
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
    /// The lock file beside the announcement cannot be used.
    #[error(transparent)]
    Lock(LockError),
    /// The runtime folder cannot be used.
    #[error(transparent)]
    Cell(#[from] CellError),
}

/// A published announcement; dropping it removes the file. If the process dies, the kernel releases the lock.
#[derive(Debug)]
pub struct Announced {
    announcement: Announcement,
    path: PathBuf,
    lock_path: PathBuf,
    lock: Flock<File>,
}

impl Announced {
    /// Returns the announcement.
    #[must_use]
    pub fn announcement(&self) -> &Announcement {
        &self.announcement
    }

    /// Replaces the services and the note; role, label and process identity stay the same.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written; the old announcement then stays in force.
    pub fn update(
        &mut self,
        services: BTreeMap<String, String>,
        note: &str,
    ) -> Result<(), AnnounceError> {
        let next = Announcement {
            services,
            note: note.to_owned(),
            ..self.announcement.clone()
        };
        write(&self.path, &next)?;
        self.announcement = next;
        Ok(())
    }
}

impl Drop for Announced {
    fn drop(&mut self) {
        // The cell was released: files at these paths now belong to another process.
        if !lock::is_locked_file(&self.lock_path, &self.lock) {
            return;
        }
        // Only the holder of the lock writes or removes these files. A failure is harmless: the next process of this
        // role and label replaces them.
        if read(&self.path).is_ok_and(|found| {
            found.is_some_and(|a| a.incarnation == self.announcement.incarnation)
        }) {
            let _ = fs::remove_file(&self.path);
        }
        let _ = fs::remove_file(&self.lock_path);
    }
}

impl Cell {
    /// Publishes the announcement, so that other processes find this one. A second process with the same role and label
    /// is refused.
    ///
    /// # Errors
    /// Returns [`AnnounceError::AlreadyRunning`] if such a process runs, or an error if a file cannot be written.
    pub fn announce(&self, announcement: &Announcement) -> Result<Announced, AnnounceError> {
        self.make_folders()?;
        let path = self.announcement_file(announcement.role, &announcement.label);
        let lock_path = path.with_extension("lock");
        let lock = match lock::exclusive(&lock_path) {
            Ok(lock) => lock,
            Err(LockError::Held { .. }) => {
                let pid = read(&path).ok().flatten().map_or(0, |other| other.pid);
                return Err(AnnounceError::AlreadyRunning {
                    role: announcement.role,
                    label: announcement.label.clone(),
                    cell: self.name().to_owned(),
                    pid,
                });
            }
            Err(error) => return Err(AnnounceError::Lock(error)),
        };
        write(&path, announcement)?;
        Ok(Announced {
            announcement: announcement.clone(),
            path,
            lock_path,
            lock,
        })
    }

    /// Returns the announcement with this role and label, whether its process is alive or dead.
    ///
    /// # Errors
    /// Returns an error if the file exists but cannot be read.
    pub fn announced(
        &self,
        role: Role,
        label: &str,
    ) -> Result<Option<Announcement>, AnnounceError> {
        read(&self.announcement_file(role, label))
    }

    /// Returns all announcements of the cell, of live and dead processes, sorted by role and label. Skips files that
    /// are not announcements, so that one bad file does not hide the others ([`Cell::announced`] reports such a file).
    ///
    /// # Errors
    /// Returns an error if the folder or a file cannot be read, because an incomplete list would be wrong. A missing
    /// folder counts as empty.
    pub fn announced_all(&self) -> Result<Vec<Announcement>, AnnounceError> {
        let folder = self.processes_dir();
        let failed = |source| AnnounceError::File {
            path: folder.clone(),
            source,
        };
        let entries = match fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(failed(error)),
        };
        let mut all = Vec::new();
        for entry in entries {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_none_or(|extension| extension != "json") {
                continue;
            }
            match read(&path) {
                Ok(announcement) => all.extend(announcement),
                Err(AnnounceError::Malformed { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        all.sort_by(|a, b| (a.role, &a.label).cmp(&(b.role, &b.label)));
        Ok(all)
    }

    pub(crate) fn announcement_file(&self, role: Role, label: &str) -> PathBuf {
        self.processes_dir().join(format!("{role}-{label}.json"))
    }
}

fn read(path: &Path) -> Result<Option<Announcement>, AnnounceError> {
    match file::read(path, BYTES_MAX) {
        Ok(text) => {
            serde_json::from_slice(&text)
                .map(Some)
                .map_err(|source| AnnounceError::Malformed {
                    path: path.to_owned(),
                    source,
                })
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(AnnounceError::File {
            path: path.to_owned(),
            source,
        }),
    }
}

fn write(path: &Path, announcement: &Announcement) -> Result<(), AnnounceError> {
    let failed = |source| AnnounceError::File {
        path: path.to_owned(),
        source,
    };
    let text = serde_json::to_vec_pretty(announcement).map_err(|error| failed(error.into()))?;
    file::replace(path, &text, Readers::Owner).map_err(failed)
}
