//! Announcements: the small file by which a process tells the others of its cell who it is and what it offers.
//! Written and read by threads that are not real-time.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use nix::fcntl::Flock;

use crate::build::Build;
use crate::cell::{Cell, CellError};
use crate::clean::write_private;
use crate::configuration::Configuration;
use crate::lock::{self, LockError};
use crate::ownership;
use crate::process_instance::{Liveness, ProcessInstance};
use crate::session::{Role, Session};

/// Longest announcement that is read, bytes.
const BYTES_MAX: u64 = 1 << 20;

/// Who a process is, and the full names of its services.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Announcement {
    /// What it does in the cell.
    pub role: Role,
    /// Which one of its role; a driver's is its device's name.
    pub label: String,
    /// Which life of a process it is: no other one has this number.
    #[serde(with = "hexadecimal")]
    pub incarnation: u64,
    /// Its process id.
    pub pid: u32,
    /// Its start, in clock ticks after boot.
    pub start_time_ticks: u64,
    /// Full service names by short names.
    #[serde(default)]
    pub services: BTreeMap<String, String>,
    /// A word for people.
    #[serde(default)]
    pub note: String,
    /// The configuration that it was started with; `None` of processes that need none, and of older builds.
    #[serde(default)]
    pub configuration: Option<Configuration>,
    /// Of which build it is; `None` of older builds, which do not announce it.
    #[serde(default)]
    pub build: Option<Build>,
}

impl Announcement {
    /// The announcement of this process, still without services.
    #[must_use]
    pub fn of(session: &Session) -> Announcement {
        let life = session.instance();
        Announcement {
            role: session.role(),
            label: session.label().to_owned(),
            incarnation: life.incarnation(),
            pid: life.pid,
            start_time_ticks: life.start_time_ticks,
            services: BTreeMap::new(),
            note: String::new(),
            configuration: None,
            build: Some(Build::own()),
        }
    }

    /// Adds the service `full` under the short name `name`.
    #[must_use]
    pub fn service(mut self, name: &str, full: &str) -> Announcement {
        self.services.insert(name.to_owned(), full.to_owned());
        self
    }

    /// Sets the word for people.
    #[must_use]
    pub fn note(mut self, note: &str) -> Announcement {
        note.clone_into(&mut self.note);
        self
    }

    /// Sets the configuration that it was started with.
    #[must_use]
    pub fn configured(mut self, configuration: Configuration) -> Announcement {
        self.configuration = Some(configuration);
        self
    }

    /// Who it is, for people: `executor`, `driver io`.
    #[must_use]
    pub fn who(&self) -> String {
        match self.role {
            Role::Driver => format!("driver {}", self.label),
            role => role.to_string(),
        }
    }

    /// The life of the process that announced this.
    #[must_use]
    pub fn instance(&self) -> ProcessInstance {
        ProcessInstance {
            pid: self.pid,
            start_time_ticks: self.start_time_ticks,
        }
    }

    /// Whether that very process runs (a zombie does not), as far as the system tells.
    #[must_use]
    pub fn liveness(&self) -> Liveness {
        self.instance().liveness()
    }
}

/// Why an announcement was not made or not read.
#[derive(Debug, thiserror::Error)]
pub enum AnnounceError {
    /// A living process already has this role and label in the cell.
    #[error(
        "{role} '{label}' already runs in cell '{cell}' (process {pid}): stop it, or use another cell"
    )]
    AlreadyRunning {
        /// The role.
        role: Role,
        /// The label.
        label: String,
        /// The cell.
        cell: String,
        /// The process that runs; 0 when it has not yet said who it is.
        pid: u32,
    },
    /// A file that is not an announcement.
    #[error("{path} is not an announcement ({source}): remove it")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A file that cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The lock beside the announcement cannot be used.
    #[error(transparent)]
    Lock(LockError),
    /// The runtime folder cannot be used.
    #[error(transparent)]
    Cell(#[from] CellError),
}

/// An announcement in force; dropping it takes it back. The kernel does the same for its lock at any death.
#[derive(Debug)]
pub struct Announced {
    announcement: Announcement,
    path: PathBuf,
    lock_path: PathBuf,
    lock: Flock<File>,
}

impl Announced {
    /// What is announced.
    #[must_use]
    pub fn announcement(&self) -> &Announcement {
        &self.announcement
    }

    /// Announces something else instead (more services, another note); role, label and life stay.
    ///
    /// # Errors
    /// The file cannot be written; then the old announcement stays.
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
        // Given back with the cell: what lies there now is somebody else's.
        if !ownership::is_locked_file(&self.lock_path, &self.lock) {
            return;
        }
        // Nobody but the holder of the lock writes or removes these files; failing to is harmless, as the next
        // process of this role and label replaces them.
        if read(&self.path).is_ok_and(|found| {
            found.is_some_and(|a| a.incarnation == self.announcement.incarnation)
        }) {
            let _ = fs::remove_file(&self.path);
        }
        let _ = fs::remove_file(&self.lock_path);
    }
}

impl Cell {
    /// Announces a process: from now on others find it, and a second one of the same role and label is refused.
    ///
    /// # Errors
    /// [`AnnounceError::AlreadyRunning`], or files that cannot be written.
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

    /// What the process of this role and label announced, living or dead.
    ///
    /// # Errors
    /// A file that is there but cannot be read.
    pub fn announced(
        &self,
        role: Role,
        label: &str,
    ) -> Result<Option<Announcement>, AnnounceError> {
        read(&self.announcement_file(role, label))
    }

    /// All announcements of the cell, living or dead, by role and label. Files that are not announcements are left
    /// out here (asked for by name they are an error), so that one of them does not hide the others.
    ///
    /// # Errors
    /// The folder (a missing one is empty) or a file cannot be read: a list that lacks processes would be an untrue one.
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
    match rcc_os::file::read(path, BYTES_MAX) {
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

/// Writes beside and renames, so that readers see the old file or the new one, and never a part.
fn write(path: &Path, announcement: &Announcement) -> Result<(), AnnounceError> {
    let failed = |source| AnnounceError::File {
        path: path.to_owned(),
        source,
    };
    let text = serde_json::to_vec_pretty(announcement).map_err(|error| failed(error.into()))?;
    let beside = path.with_extension("new");
    write_private(&beside, &text)
        .and_then(|()| fs::rename(&beside, path))
        .map_err(failed)
}

/// 64 bits as text: JSON readers in other languages keep only 53 of a number.
pub(crate) mod hexadecimal {
    use serde::de::{Deserialize, Deserializer, Error};

    pub fn serialize<S: serde::Serializer>(value: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&format!("{value:016x}"))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        let digits = String::deserialize(deserializer)?;
        u64::from_str_radix(&digits, 16).map_err(D::Error::custom)
    }
}
