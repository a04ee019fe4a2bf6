//! The state folder of a cell: its event log, incident files and logs. Unlike the runtime folder it outlives the cell
//! and a restart of the machine. Runs on any thread that is not real-time.

use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, symlink};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::base_folder::base_dir;
use crate::cell_error::{CellError, person};

/// State folder of services, and of root.
const OF_SERVICES: &str = "/var/lib/rcc";
/// Runtime folder of services, and of root.
const RUNTIME_OF_SERVICES: &str = "/run/rcc";
/// Folder in the base folder with one folder for each cell.
const CELLS: &str = "cells";
/// Symbolic link in a cell's folder to the folder that the cell's configuration names.
const LINK: &str = "folder";

/// Folder of the event log, the incidents and the logs of one cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StateFolder {
    path: PathBuf,
}

impl StateFolder {
    /// Returns the state folder of the cell `name` of this user if it exists, whether or not the cell does.
    #[must_use]
    pub fn find(name: &str) -> Option<StateFolder> {
        let folder = StateFolder::at(&anchor(name));
        folder.path.is_dir().then_some(folder)
    }

    /// Returns the names of this user's cells that have a state folder, sorted.
    #[must_use]
    pub fn names() -> Vec<String> {
        let entries = fs::read_dir(state_base().join(CELLS));
        let entries = entries.into_iter().flatten().flatten();
        let mut names: Vec<String> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    /// Follows the link of a cell's folder, if the cell's configuration names another one.
    pub(crate) fn at(anchor: &Path) -> StateFolder {
        let path = fs::read_link(anchor.join(LINK)).unwrap_or_else(|_| anchor.to_owned());
        StateFolder { path }
    }

    /// Returns the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the path of the current log file.
    #[must_use]
    pub fn events_file(&self) -> PathBuf {
        self.path.join("events.jsonl")
    }

    /// Returns the path of the log file that was rotated as number `number`.
    pub(crate) fn rotated_events_file(&self, number: u64) -> PathBuf {
        self.path.join(format!("events.{number}.jsonl"))
    }

    pub(crate) fn events_lock_file(&self) -> PathBuf {
        self.path.join("events.lock")
    }

    /// Returns the folder of the flight recorder's incident files.
    #[must_use]
    pub fn incidents_dir(&self) -> PathBuf {
        self.path.join("incidents")
    }

    /// Returns the folder of the logs of `rcc-cli up`, with one folder for each run.
    #[must_use]
    pub fn logs_dir(&self) -> PathBuf {
        self.path.join("logs")
    }

    /// Returns the folder of logs into which this process writes its stderr, if `rcc-cli up` started it.
    #[must_use]
    pub fn own_logs(&self) -> Option<PathBuf> {
        // For a file the link is its path, without symbolic links.
        self.logs_with(&fs::read_link("/proc/self/fd/2").ok()?)
    }

    /// Returns the folder of one run that contains the log `file`, as a path below [`StateFolder::logs_dir`].
    fn logs_with(&self, file: &Path) -> Option<PathBuf> {
        let logs = self.logs_dir();
        let run = file.parent()?;
        let here = run.parent()? == fs::canonicalize(&logs).ok()?;
        here.then(|| Some(logs.join(run.file_name()?)))?
    }

    /// Returns the rotated log files, oldest first, with their numbers.
    pub(crate) fn rotated_events(&self) -> Vec<(u64, PathBuf)> {
        let entries = fs::read_dir(&self.path).into_iter().flatten().flatten();
        let mut rotated: Vec<(u64, PathBuf)> = entries
            .filter_map(|entry| {
                let name = entry.file_name().into_string().ok()?;
                let number = name.strip_prefix("events.")?.strip_suffix(".jsonl")?;
                Some((number.parse().ok()?, entry.path()))
            })
            .collect();
        rotated.sort();
        rotated
    }

    /// Removes the oldest rotated logs, logs of earlier runs and incident files (those for which `is_incident` is true)
    /// until all files together have at most `keep` bytes. The current event log, the logs of the newest run and the
    /// newest incident stay; `newest` are the paths of these two as far as the caller knows them. Without them the wall
    /// clock decides: what it dates in the future was written before it was set back, and counts as the oldest.
    /// Returns what was removed.
    ///
    /// # Errors
    /// Returns an error if a file cannot be removed.
    pub fn remove_oldest(
        &self,
        keep: u64,
        newest: &[&Path],
        is_incident: impl Fn(&Path) -> bool,
    ) -> io::Result<Vec<PathBuf>> {
        let mut total = size_of(&self.events_file());
        let mut old = Vec::new();
        let now = SystemTime::now();
        let rotated = self.rotated_events().into_iter();
        old.extend(rotated.map(|(_, path)| StoredItem::of(path, now)));
        let mut incidents = listed(&self.incidents_dir());
        incidents.retain(|path| is_incident(path));
        let mut logs = listed(&self.logs_dir());
        logs.retain(|path| path.is_dir());
        for all in [incidents, logs] {
            let items = all.into_iter().map(|path| StoredItem::of(path, now));
            let mut all: Vec<StoredItem> = items.collect();
            let is_newest = |item: &StoredItem| newest.contains(&item.path.as_path());
            all.sort_by_key(|item| (is_newest(item), item.age));
            total += all.pop().map_or(0, |newest| newest.size);
            old.append(&mut all);
        }
        total += old.iter().map(|item| item.size).sum::<u64>();
        old.sort_by_key(|item| item.age);
        let mut removed = Vec::new();
        for item in old {
            if total <= keep {
                break;
            }
            let done = match item.path.is_dir() {
                true => fs::remove_dir_all(&item.path),
                false => fs::remove_file(&item.path),
            };
            match done {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => removed.push(item.path),
            }
            total -= item.size;
        }
        Ok(removed)
    }
}

/// A file, or a folder with everything below it.
struct StoredItem {
    path: PathBuf,
    /// False if the date is in the future; the date. The oldest has the smallest.
    age: (bool, SystemTime),
    size: u64,
}

impl StoredItem {
    fn of(path: PathBuf, now: SystemTime) -> StoredItem {
        let found = fs::symlink_metadata(&path);
        let modified = found.and_then(|found| found.modified());
        let modified = modified.unwrap_or(SystemTime::UNIX_EPOCH);
        StoredItem {
            age: (modified <= now, modified),
            size: size_of(&path),
            path,
        }
    }
}

fn listed(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).collect()
}

fn size_of(path: &Path) -> u64 {
    match fs::symlink_metadata(path) {
        Err(_) => 0,
        Ok(found) if found.is_dir() => listed(path).iter().map(|path| size_of(path)).sum(),
        Ok(found) => found.len(),
    }
}

/// Returns the folder of this user for what outlives cells: `$RCC_STATE_DIR`, else `/var/lib/rcc` for root and for the
/// cells of services (those in `/run/rcc`), else `$XDG_STATE_HOME/rcc`, else `~/.local/state/rcc`. It need not exist.
#[must_use]
pub fn state_base() -> PathBuf {
    let variable = |name| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let uid = nix::unistd::getuid();
    if let Some(folder) = variable("RCC_STATE_DIR") {
        return std::path::absolute(&folder).unwrap_or(folder);
    }
    if uid.is_root() || base_dir() == Path::new(RUNTIME_OF_SERVICES) {
        return PathBuf::from(OF_SERVICES);
    }
    // The XDG Base Directory Specification demands that relative paths are ignored.
    let absolute = |path: &PathBuf| path.is_absolute();
    let home = || {
        let user = nix::unistd::User::from_uid(uid).ok().flatten();
        variable("HOME").or(user.map(|user| user.dir))
    };
    let xdg = variable("XDG_STATE_HOME").filter(absolute);
    match xdg.or_else(|| Some(home()?.join(".local/state")).filter(absolute)) {
        Some(folder) => folder.join("rcc"),
        None => PathBuf::from(format!("/var/tmp/rcc-{uid}")),
    }
}

/// Returns the folder of the cell `name`: its state folder, unless the cell's configuration names another folder.
pub(crate) fn anchor(name: &str) -> PathBuf {
    state_base().join(CELLS).join(name)
}

/// Creates the state folder of the cell `name`: `<folder>/<name>` if the configuration names a folder, to which a link
/// then leads from `anchor`, else `anchor`.
///
/// # Errors
/// Returns an error if a folder cannot be created, belongs to another user, or can be written by others.
pub(crate) fn create(anchor: &Path, name: &str, folder: Option<&Path>) -> Result<(), CellError> {
    make_private(anchor)?;
    let link = anchor.join(LINK);
    let failed = |source| CellError::State {
        path: link.clone(),
        source,
    };
    let Some(folder) = folder else {
        return match fs::read_link(&link).and_then(|_| fs::remove_file(&link)) {
            // Not a link: a file of somebody else, which does not matter.
            Err(error)
                if !matches!(
                    error.kind(),
                    io::ErrorKind::NotFound | io::ErrorKind::InvalidInput
                ) =>
            {
                Err(failed(error))
            }
            _ => Ok(()),
        };
    };
    let folder = std::path::absolute(folder.join(name)).map_err(failed)?;
    make_private(&folder)?;
    if fs::read_link(&link).is_ok_and(|target| target == folder) {
        return Ok(());
    }
    // Renamed, so that the processes of a cell, which all do this at their start, never find it missing.
    let new = anchor.join(format!("{LINK}.{}", std::process::id()));
    let renamed = match symlink(&folder, &new) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        made => made,
    };
    renamed
        .and_then(|()| fs::rename(&new, &link))
        .map_err(failed)
}

fn make_private(path: &Path) -> Result<(), CellError> {
    let failed = |source| CellError::State {
        path: path.to_owned(),
        source,
    };
    DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(path)
        .map_err(failed)?;
    let found = fs::metadata(path).map_err(failed)?;
    let denied = |words: String| failed(io::Error::new(io::ErrorKind::PermissionDenied, words));
    let uid = nix::unistd::getuid().as_raw();
    if found.uid() != uid {
        let words = format!(
            "it belongs to {}, you are {}",
            person(found.uid()),
            person(uid)
        );
        return Err(denied(words));
    }
    if found.mode() & 0o022 != 0 {
        let (mode, path) = (found.mode() & 0o7777, path.display());
        return Err(denied(format!(
            "it can be written by others (mode {mode:04o}): `chmod go-w {path}`"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
