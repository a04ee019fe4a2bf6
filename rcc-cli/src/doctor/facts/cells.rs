//! The cells of this user and their folder: living processes, health, and leftovers. Run by the main thread; asks loaders with a short
//! time-out, and changes nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use procfs::process::{FDTarget, all_processes};
use rcc_api::bodies::{ExecutorView, StatusView};
use rcc_ipc::Cell;
use rcc_os::wall;

use crate::client::LoaderClient;

/// Longest time to wait for a loader's answer.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);
/// Length of the prefix of names in `/dev/shm`: `rcc_`, 10 hexadecimal digits and `_`.
const PREFIX_LENGTH: usize = 15;
/// Files younger than this may belong to a process that has not mapped them yet.
const STRAY_AGE_MIN: Duration = Duration::from_secs(60);

/// One cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellFacts {
    /// Name.
    pub name: String,
    /// Folder.
    pub folder: PathBuf,
    /// Living processes, as `role/label (pid)`.
    pub living: Vec<String>,
    /// Dead processes that are still announced.
    pub dead: Vec<String>,
    /// Number of files in shared memory.
    pub files: usize,
    /// Their size, bytes.
    pub bytes: u64,
    /// Reason why the folder cannot be inspected.
    pub refused: Option<String>,
    /// Executor's status, if the loader answers.
    pub executor: Option<ExecutorView>,
}

/// Shared memory under a prefix that belongs to no cell in the usual base folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StrayMemory {
    /// Prefix of the names.
    pub prefix: String,
    /// Files and folders.
    pub paths: Vec<PathBuf>,
    /// Size, bytes.
    pub bytes: u64,
    /// Owner's user id.
    pub owner: u32,
    /// True if a process has one of them open or mapped, or if they are too young to exclude that.
    pub used: bool,
}

/// A folder that may not exist.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FolderFacts {
    /// Path.
    pub path: PathBuf,
    /// Owner's user id, if it exists.
    pub owner: Option<u32>,
    /// Permission bits; 0 if it does not exist.
    pub mode: u32,
    /// True if this user can create files in it, or create it.
    pub usable: bool,
}

/// Inspects a folder; creates nothing.
#[must_use]
pub fn folder(path: &Path) -> FolderFacts {
    let found = fs::metadata(path).ok().filter(fs::Metadata::is_dir);
    let nearest = path.ancestors().find(|above| above.exists());
    let access = nix::unistd::AccessFlags::W_OK | nix::unistd::AccessFlags::X_OK;
    let allowed = nearest
        .is_some_and(|nearest| nearest.is_dir() && nix::unistd::access(nearest, access).is_ok());
    FolderFacts {
        path: path.to_owned(),
        owner: found.as_ref().map(MetadataExt::uid),
        mode: found.as_ref().map_or(0, |found| found.mode() & 0o7777),
        usable: allowed,
    }
}

/// Returns the cells below `base`.
#[must_use]
pub fn read(base: &Path) -> Vec<CellFacts> {
    let entries = fs::read_dir(base).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter(|entry| entry.path().is_dir())
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    names
        .into_iter()
        .filter_map(|name| cell(base, name))
        .collect()
}

/// Reads one cell; `None` if the name cannot be a cell's.
fn cell(base: &Path, name: String) -> Option<CellFacts> {
    let folder = base.join(&name);
    let cell = match Cell::find(&name) {
        Ok(Some(cell)) => cell,
        Ok(None) | Err(rcc_ipc::CellError::BadName { .. }) => return None,
        Err(error) => {
            return Some(CellFacts {
                name,
                folder,
                refused: Some(error.to_string()),
                ..CellFacts::default()
            });
        }
    };
    let announced = cell.announced_all().unwrap_or_default();
    // Processes that may be alive do not count as dead, because the dead ones' files are offered for removal.
    let (dead, living): (Vec<_>, Vec<_>) =
        announced.iter().partition(|one| one.liveness().is_dead());
    let labels = |all: Vec<&rcc_protocol::Announcement>| -> Vec<String> {
        all.iter()
            .map(|one| format!("{}/{} (pid {})", one.role, one.label, one.pid))
            .collect()
    };
    let left = cell.leftovers().unwrap_or_default();
    let executor = (!living.is_empty())
        .then(|| LoaderClient::new(&name, &cell.socket(), ANSWER_TIMEOUT).ok())
        .flatten()
        .and_then(|client| client.get::<StatusView>("/status").ok())
        .map(|status| status.executor);
    Some(CellFacts {
        living: labels(living),
        dead: labels(dead),
        files: left.len(),
        bytes: left.iter().map(|path| size(path)).sum(),
        refused: None,
        executor,
        folder,
        name,
    })
}

/// Returns the shared memory in `shm` that belongs to no cell below `base`.
#[must_use]
pub fn strays(shm: &Path, base: &Path) -> Vec<StrayMemory> {
    let known: BTreeSet<String> = known_prefixes(base);
    let mut all: BTreeMap<String, StrayMemory> = BTreeMap::new();
    for entry in fs::read_dir(shm).into_iter().flatten().flatten() {
        let Some(prefix) = entry
            .file_name()
            .to_str()
            .and_then(prefix_of)
            .map(str::to_owned)
        else {
            continue;
        };
        let Ok(found) = fs::symlink_metadata(entry.path()) else {
            continue;
        };
        if known.contains(&prefix) {
            continue;
        }
        let stray = all.entry(prefix.clone()).or_insert_with(|| StrayMemory {
            prefix,
            ..StrayMemory::default()
        });
        stray.owner = found.uid();
        stray.bytes += size(&entry.path());
        stray.used |= is_young(&found);
        stray.paths.push(entry.path());
    }
    if !all.is_empty() {
        let used = prefixes_in_use();
        for stray in all.values_mut() {
            stray.used |= used.contains(&stray.prefix);
            stray.paths.sort();
        }
    }
    all.into_values().collect()
}

fn known_prefixes(base: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(base).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let cells = names.filter_map(|name| Cell::find(&name).ok().flatten());
    cells.map(|cell| cell.prefix().to_owned()).collect()
}

/// Returns the prefix of a name such as `rcc_0123456789_…`.
fn prefix_of(name: &str) -> Option<&str> {
    let prefix = name.get(..PREFIX_LENGTH)?;
    let digits = prefix.strip_prefix("rcc_")?.strip_suffix('_')?;
    digits
        .bytes()
        .all(|byte| byte.is_ascii_hexdigit())
        .then_some(prefix)
}

fn is_young(found: &fs::Metadata) -> bool {
    // A modification time in the future says nothing about the age: counts as young, so it is not removed.
    found
        .modified()
        .ok()
        .and_then(wall::age)
        .is_none_or(|age| age < STRAY_AGE_MIN)
}

/// Returns the prefixes that occur in the maps and open files of all processes that may be inspected.
fn prefixes_in_use() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for process in all_processes().into_iter().flatten().flatten() {
        // As text: a line that a parser does not know must not hide the others.
        let maps = fs::read_to_string(format!("/proc/{}/maps", process.pid)).unwrap_or_default();
        found.extend(maps.lines().filter_map(prefix_in));
        for file in process.fd().into_iter().flatten().flatten() {
            if let FDTarget::Path(path) = file.target {
                found.extend(path.to_str().and_then(prefix_in));
            }
        }
    }
    found
}

fn prefix_in(text: &str) -> Option<String> {
    let (_, after) = text.split_once("/dev/shm/")?;
    prefix_of(after).map(str::to_owned)
}

/// Returns the size of a file, or of everything below a folder, bytes.
fn size(path: &Path) -> u64 {
    let Ok(found) = fs::symlink_metadata(path) else {
        return 0;
    };
    if !found.is_dir() {
        return found.blocks() * 512;
    }
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    entries.map(|entry| size(&entry.path())).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_of_cells_are_recognised() {
        assert_eq!(
            prefix_of("rcc_0123456789_x.dynamic"),
            Some("rcc_0123456789_")
        );
        for other in [
            "rcc_test_x",
            "rcc_0123456789",
            "sem.rcc_0123456789_",
            "rcc_012345678g_x",
            "ä",
        ] {
            assert_eq!(prefix_of(other), None, "{other}");
        }
        let mapped = "7f00-7f01 rw-s 0 00:17 5 /dev/shm/rcc_0123456789_abc";
        assert_eq!(prefix_in(mapped).as_deref(), Some("rcc_0123456789_"));
    }

    #[test]
    fn young_files_under_an_unknown_prefix_count_as_used() -> std::io::Result<()> {
        let temporary = rcc_testing::folder();
        let folder = temporary.path();
        fs::create_dir_all(folder.join("base"))?;
        fs::write(folder.join("rcc_0123456789_a"), [1; 4096])?;
        fs::write(folder.join("rcc_0123456789_b"), [1; 4096])?;
        fs::write(folder.join("other"), "")?;
        let found = strays(folder, &folder.join("base"));
        let old = std::time::SystemTime::now() - 2 * STRAY_AGE_MIN;
        for path in &found[0].paths {
            fs::File::options()
                .write(true)
                .open(path)?
                .set_modified(old)?;
        }
        let later = strays(folder, &folder.join("base"));
        assert_eq!(
            (found.len(), found[0].paths.len(), found[0].used),
            (1, 2, true)
        );
        assert!(!later[0].used && later[0].bytes >= 8192, "{later:?}");
        Ok(())
    }

    #[test]
    fn a_missing_folder_is_judged_by_its_nearest_ancestor() {
        let path = std::env::temp_dir().join(format!("rcc-none-{}/a/b", std::process::id()));
        let missing = folder(&path);
        assert!(missing.usable && missing.owner.is_none());
        let below_a_file = folder(Path::new("/proc/version/x"));
        assert!(!below_a_file.usable);
    }
}
