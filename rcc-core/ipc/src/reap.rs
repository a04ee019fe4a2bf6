//! Removes the files of dead processes that iceoryx2's own cleaning leaves or fails on, identified by their names. Run
//! only by the janitor's process, after iceoryx2 has cleaned.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rcc_os::process_instance::started_ns;
use rcc_os::{file, wall};

use crate::cell::Cell;
use crate::{spill_file, wake};

/// Upper bound of the difference between clock ticks, clocks and their reading, ns.
const CLOCK_SLACK_NS: u64 = 50_000_000;
/// Maximum size of a service description that is read, bytes; typical is one kilobyte.
const DESCRIPTION_MAX: u64 = 64 << 10;
/// A file of iceoryx2 that is still empty after this time was never finished (iceoryx2 itself waits 100 ms).
const UNFINISHED_AFTER: Duration = Duration::from_secs(1);

/// The id in the names of files and nodes (`UniqueSystemId` of iceoryx2 0.10.0), least significant part first: seconds
/// and nanoseconds of CLOCK_MONOTONIC at its creation, process id, counter; 32 bits each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct UniqueId {
    created_ns: u64,
    pid: u32,
}

impl UniqueId {
    fn from_value(value: u128) -> UniqueId {
        let part = |index: u32| (value >> (32 * index)) as u32;
        UniqueId {
            created_ns: u64::from(part(0)) * 1_000_000_000 + u64::from(part(1)),
            pid: part(2),
        }
    }

    /// Returns true if the process that created this id is known to be dead; files of a process that may live are kept.
    /// A process id may have been reused; the new process then started after the id was created.
    fn creator_is_dead(self) -> bool {
        let made_by = |started| started <= self.created_ns + CLOCK_SLACK_NS;
        started_ns(self.pid).is_ok_and(|started| !started.is_some_and(made_by))
    }
}

/// Returns the ids in a file name; all other digit strings in such names are far shorter.
fn ids_in(name: &str) -> impl Iterator<Item = UniqueId> {
    name.split(['_', '.'])
        .filter(|part| part.len() >= 15)
        .filter_map(|part| part.parse().ok().map(UniqueId::from_value))
}

/// Ids whose creators were dead at one moment.
#[derive(Debug)]
pub(crate) struct DeadProcesses(BTreeSet<UniqueId>);

impl DeadProcesses {
    /// Collects the ids of dead creators from all files of the cell. Call it before iceoryx2 cleans: a process that
    /// dies after that has not been unregistered from what it shared with the living, so its node must stay for the
    /// next run. If a node is removed too early, its slot in a live board stays occupied forever.
    ///
    /// # Errors
    /// Returns an error with its path if a folder cannot be read.
    pub(crate) fn of(cell: &Cell) -> Result<DeadProcesses, (PathBuf, io::Error)> {
        let here = |error| (PathBuf::from(crate::shm_space::SHM), error);
        let mut paths = cell.leftovers().map_err(here)?;
        paths.extend(files_in(&cell.iox_root().join("nodes"))?);
        let mut ids: BTreeSet<UniqueId> = paths
            .iter()
            .flat_map(|path| ids_in(&name_of(path)).collect::<Vec<_>>())
            .collect();
        for path in files_in(&cell.iox_root().join("services"))? {
            let text = file::read_text(&path, DESCRIPTION_MAX).unwrap_or_default();
            ids.extend(service_id(&text).map(UniqueId::from_value));
        }
        ids.retain(|id| id.creator_is_dead());
        Ok(DeadProcesses(ids))
    }

    fn created(&self, name: &str) -> bool {
        ids_in(name).any(|id| self.0.contains(&id))
    }
}

/// Removes what dead processes left in shared memory and in iceoryx2's folders. Returns the number of removed files.
///
/// # Errors
/// Returns an error with its path if a folder cannot be read, or if a file cannot be removed.
pub(crate) fn reap(cell: &Cell, dead: &DeadProcesses) -> Result<usize, (PathBuf, io::Error)> {
    Ok(reap_shared_memory(cell, dead)?
        + reap_services(cell, dead)?
        + reap_nodes(cell, dead)?
        + reap_spill_files(cell)?)
}

/// Frees memory without creating anything: removes shared memory of dead processes that no process has mapped, and
/// their spill files. Nodes and services stay for iceoryx2. Returns the number of removed files.
///
/// # Errors
/// As [`reap`].
pub(crate) fn free(cell: &Cell, dead: &DeadProcesses) -> Result<usize, (PathBuf, io::Error)> {
    Ok(reap_shared_memory(cell, dead)? + reap_spill_files(cell)?)
}

/// Returns true if the file name identifies its creators and all of them are dead.
pub(crate) fn is_orphaned(path: &Path) -> bool {
    let name = name_of(path);
    let mut makers = ids_in(&name).peekable();
    makers.peek().is_some() && makers.all(|id| id.creator_is_dead())
}

/// Removes spill files whose sender is dead, and sockets whose server is.
fn reap_spill_files(cell: &Cell) -> Result<usize, (PathBuf, io::Error)> {
    let mut dead = files_in(&cell.iox_root())?;
    dead.retain(|path| {
        let name = name_of(path);
        let owner = spill_file::owner_of(&name).or_else(|| wake::owner_of(&name));
        owner.is_some_and(|owner| owner.liveness().is_dead())
    });
    remove_all(dead)
}

/// Removes shared memory that a dead process took part in and that no process has mapped. Memory still mapped by a live
/// process is left for that process to clean.
fn reap_shared_memory(
    cell: &Cell,
    processes: &DeadProcesses,
) -> Result<usize, (PathBuf, io::Error)> {
    let here = |error| (PathBuf::from(crate::shm_space::SHM), error);
    let mut dead = cell.shared_memory().map_err(here)?;
    dead.retain(|path| processes.created(&name_of(path)));
    if dead.is_empty() {
        return Ok(0);
    }
    let mapped = mapped_files(cell).map_err(|error| (PathBuf::from("/proc"), error))?;
    dead.retain(|path| !mapped.contains(path));
    remove_all(dead)
}

/// Removes descriptions of services whose creator is dead and whose shared memory is gone, and unfinished descriptions.
fn reap_services(cell: &Cell, processes: &DeadProcesses) -> Result<usize, (PathBuf, io::Error)> {
    let shared = cell
        .shared_memory()
        .map_err(|error| (PathBuf::from(crate::shm_space::SHM), error))?;
    let names: Vec<String> = shared.iter().map(|path| name_of(path)).collect();
    let mut dead = files_in(&cell.iox_root().join("services"))?;
    dead.retain(|path| {
        match file::read_text(path, DESCRIPTION_MAX)
            .ok()
            .and_then(|text| service_id(&text))
        {
            Some(value) => {
                let digits = value.to_string();
                processes.0.contains(&UniqueId::from_value(value))
                    && !names.iter().any(|name| name.contains(digits.as_str()))
            }
            None => is_unfinished(path),
        }
    });
    remove_all(dead)
}

/// Removes folders and lock files of nodes whose process is dead.
fn reap_nodes(cell: &Cell, processes: &DeadProcesses) -> Result<usize, (PathBuf, io::Error)> {
    let nodes = cell.iox_root().join("nodes");
    let mut removed = 0;
    for path in files_in(&nodes)? {
        if !processes.created(&name_of(&path)) {
            continue;
        }
        if path.is_dir() {
            match fs::remove_dir_all(&path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err((path, error)),
                _ => removed += 1,
            }
        } else {
            removed += remove_all(vec![path])?;
        }
    }
    Ok(removed)
}

/// Returns the id of a service from its description.
fn service_id(text: &str) -> Option<u128> {
    let section = text.split_once("[unique_service_id]")?.1;
    let value = |name: &str| -> Option<u128> {
        let line = section.lines().find(|line| line.starts_with(name))?;
        line.split_once('=')?.1.trim().parse().ok()
    };
    Some(value("unique_value")? << 64 | value("payload_value")?)
}

/// Returns true for a description without an id that is old enough: its creator died while writing it. A date in the
/// future, after the clock was changed, counts as old; otherwise the file would stay forever.
fn is_unfinished(path: &Path) -> bool {
    let modified = fs::symlink_metadata(path).and_then(|found| found.modified());
    modified.is_ok_and(|modified| wall::age(modified).is_none_or(|age| age >= UNFINISHED_AFTER))
}

/// Returns this cell's shared memory that is mapped by any process that we may inspect.
fn mapped_files(cell: &Cell) -> io::Result<BTreeSet<PathBuf>> {
    let start = format!("{}/{}", crate::shm_space::SHM, cell.prefix());
    let mut mapped = BTreeSet::new();
    for entry in fs::read_dir("/proc")? {
        // A process may end meanwhile, and processes of other users hide their maps: neither is in this cell.
        let Ok(maps) = fs::read_to_string(entry?.path().join("maps")) else {
            continue;
        };
        for line in maps.lines() {
            if let Some(at) = line.find(&start) {
                mapped.insert(PathBuf::from(line[at..].trim_end_matches(" (deleted)")));
            }
        }
    }
    Ok(mapped)
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn files_in(folder: &Path) -> Result<Vec<PathBuf>, (PathBuf, io::Error)> {
    match fs::read_dir(folder) {
        Ok(entries) => Ok(entries.flatten().map(|entry| entry.path()).collect()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err((folder.to_owned(), error)),
    }
}

fn remove_all(paths: Vec<PathBuf>) -> Result<usize, (PathBuf, io::Error)> {
    let mut removed = 0;
    for path in paths {
        match fs::remove_file(&path) {
            Ok(()) => removed += 1,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err((path, error)),
        }
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_os::clock::monotonic_ns;

    fn id_of(pid: u32, created_ns: u64) -> u128 {
        let seconds = u128::from(created_ns / 1_000_000_000);
        let rest = u128::from(created_ns % 1_000_000_000);
        7 << 96 | u128::from(pid) << 64 | rest << 32 | seconds
    }

    #[test]
    fn the_ids_in_a_name_identify_creator_and_time() {
        let (one, two) = (id_of(12, 5_000_000_123), id_of(34, 6_000_000_456));
        let name =
            format!("rcc_0f7541e085_b9fc73e5c1f646968758453273c6c65c_{one}_{two}__1.connection");
        let found: Vec<UniqueId> = ids_in(&name).collect();
        assert_eq!(
            found,
            [
                UniqueId {
                    created_ns: 5_000_000_123,
                    pid: 12
                },
                UniqueId {
                    created_ns: 6_000_000_456,
                    pid: 34
                }
            ]
        );
        assert_eq!(
            ids_in("rcc_0f7541e085_9204dd183d1c_node.0_10_0.global_mgmt").count(),
            0
        );
    }

    #[test]
    fn a_reused_process_id_is_not_the_creator() {
        let pid = std::process::id();
        assert!(!UniqueId::from_value(id_of(pid, monotonic_ns())).creator_is_dead());
        assert!(
            UniqueId::from_value(id_of(pid, 1)).creator_is_dead(),
            "created before this process started"
        );
        assert!(UniqueId::from_value(id_of(u32::MAX, monotonic_ns())).creator_is_dead());
    }

    #[test]
    fn a_process_that_dies_while_iceoryx2_cleans_is_left_for_the_next_run() {
        let folder = rcc_testing::folder();
        let cell = Cell::at("reap", folder.path()).unwrap();
        let nodes = cell.iox_root().join("nodes");
        fs::create_dir_all(&nodes).unwrap();
        let before = DeadProcesses::of(&cell).unwrap();
        let node = nodes.join(format!("rcc_{}.node", id_of(u32::MAX, monotonic_ns())));
        fs::write(&node, "").unwrap();
        assert_eq!(reap(&cell, &before).unwrap(), 0);
        assert!(node.exists());
        assert_eq!(reap(&cell, &DeadProcesses::of(&cell).unwrap()).unwrap(), 1);
        assert!(!node.exists());
        fs::remove_dir_all(cell.iox_root()).unwrap();
    }

    #[test]
    fn a_description_contains_its_id() {
        let text =
            "name = \"x\"\n\n[unique_service_id]\npayload_value = 5\nunique_value = 3\n\n[y]\n";
        assert_eq!(service_id(text), Some(3 << 64 | 5));
        assert_eq!(service_id(""), None);
    }
}
