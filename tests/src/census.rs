//! Counts that a leak would raise: resources that a process holds, and files of a cell.
//! Run by any thread of a test.

use std::fs;
use std::path::Path;

use crate::cell_fixture::{CellFixture, files_below};
use crate::processes;

/// One count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Open file descriptors of the process.
    pub descriptors: u64,
    /// Memory mappings of the process.
    pub maps: u64,
    /// Mappings of shared memory of the process.
    pub shared_maps: u64,
    /// Threads of the process.
    pub threads: u64,
    /// Resident memory of the process, kB.
    pub rss_kb: u64,
    /// Files of the cell in shared memory.
    pub shared_files: u64,
    /// Their bytes.
    pub shared_bytes: u64,
    /// Files in the cell's runtime folder, without those that come by design.
    pub runtime_files: u64,
    /// Processes of the cell.
    pub processes: u64,
}

/// Growth of resident memory without a leak: pages of the stacks and of the allocator that are touched for the first
/// time, and memory that the allocator keeps of one net (1 MB).
const RSS_SLACK_KB: u64 = 2048;
/// Growth of shared memory without a leak: a process id of one digit more, in the files that name it.
const BYTES_SLACK: u64 = 1024;

impl Census {
    /// Counts now; `pid` is the process that is looked at.
    pub fn of(place: &CellFixture, pid: u32) -> Census {
        let (maps, status) = (read(pid, "maps"), read(pid, "status"));
        let shared = place.cell().leftovers().expect("/dev/shm can be listed");
        let sizes = shared.iter().filter_map(|path| fs::metadata(path).ok());
        let holdings = processes::holdings(pid);
        Census {
            descriptors: holdings.files as u64,
            maps: maps.lines().count() as u64,
            shared_maps: holdings.mappings as u64,
            threads: number(&status, "Threads:"),
            rss_kb: number(&status, "VmRSS:"),
            shared_files: shared.len() as u64,
            shared_bytes: sizes.map(|found| found.len()).sum(),
            runtime_files: runtime_files(place.cell().runtime_dir()),
            processes: processes::with_runtime_dir(place.folder()).len() as u64,
        }
    }

    /// Its figures with their names.
    pub fn rows(&self) -> [(&'static str, u64); 9] {
        [
            ("executor: descriptors", self.descriptors),
            ("executor: mappings", self.maps),
            ("executor: mappings of shared memory", self.shared_maps),
            ("executor: threads", self.threads),
            ("executor: resident memory, kB", self.rss_kb),
            ("cell: files in shared memory", self.shared_files),
            ("cell: bytes in shared memory", self.shared_bytes),
            ("cell: files in the runtime folder", self.runtime_files),
            ("cell: processes", self.processes),
        ]
    }

    /// Returns the counts that exceed those in `before`.
    pub fn growth(&self, before: &Census) -> Vec<String> {
        let slack = |name: &str| match name {
            name if name.contains("kB") => RSS_SLACK_KB,
            name if name.contains("bytes") => BYTES_SLACK,
            _ => 0,
        };
        let pairs = self.rows().into_iter().zip(before.rows());
        pairs
            .filter(|((name, now), (_, then))| *now > *then + slack(name))
            .map(|((name, now), (_, then))| format!("{name}: {then} → {now}"))
            .collect()
    }

    /// The larger of each figure.
    pub fn max(&self, other: &Census) -> Census {
        Census {
            descriptors: self.descriptors.max(other.descriptors),
            maps: self.maps.max(other.maps),
            shared_maps: self.shared_maps.max(other.shared_maps),
            threads: self.threads.max(other.threads),
            rss_kb: self.rss_kb.max(other.rss_kb),
            shared_files: self.shared_files.max(other.shared_files),
            shared_bytes: self.shared_bytes.max(other.shared_bytes),
            runtime_files: self.runtime_files.max(other.runtime_files),
            processes: self.processes.max(other.processes),
        }
    }
}

/// Files of the runtime folder, without what comes and goes by design: the sockets of `rcc-cli up`, and what each driver
/// knows about its device, which it writes once a second.
pub fn runtime_files(folder: &Path) -> u64 {
    let by_design = |path: &Path| {
        let below = path.strip_prefix(folder).unwrap_or(path);
        below.starts_with("up") || below.starts_with("drivers")
    };
    let files = files_below(folder);
    files.iter().filter(|path| !by_design(path)).count() as u64
}

fn read(pid: u32, what: &str) -> String {
    fs::read_to_string(format!("/proc/{pid}/{what}")).unwrap_or_default()
}

fn number(text: &str, key: &str) -> u64 {
    let line = text.lines().find_map(|line| line.strip_prefix(key));
    let word = line.and_then(|rest| rest.split_whitespace().next());
    word.and_then(|word| word.parse().ok()).unwrap_or(0)
}
