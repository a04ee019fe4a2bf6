//! Memory and swap; `/dev/shm`: file system type, size, mount options. Run by the main thread.

use super::system::{SystemRoot, value_in};

/// Memory and swap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryFacts {
    /// Memory available to programs, bytes.
    pub available: Option<u64>,
    /// Total swap, bytes.
    pub swap: u64,
    /// Swap in use, bytes.
    pub swap_used: u64,
    /// vm.overcommit_memory: 0 heuristic, 1 always, 2 never.
    pub overcommit: Option<i64>,
}

/// The file system of the cells' shared memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SharedMemoryMount {
    /// Type of the file system; `None` if nothing is mounted there.
    pub kind: Option<String>,
    /// Mount options.
    pub options: Vec<String>,
    /// Size, bytes.
    pub size: u64,
    /// Free space, bytes.
    pub free: u64,
    /// True if this user can create files there.
    pub writable: bool,
}

/// Reads `/proc/meminfo`.
#[must_use]
pub fn read(system: &SystemRoot) -> MemoryFacts {
    let text = system.text("proc/meminfo").unwrap_or_default();
    let bytes = |key| {
        let number = value_in(&text, key)?.split_whitespace().next()?;
        number.parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
    };
    let swap = bytes("SwapTotal").unwrap_or(0);
    MemoryFacts {
        available: bytes("MemAvailable"),
        swap,
        swap_used: swap.saturating_sub(bytes("SwapFree").unwrap_or(swap)),
        overcommit: system.number("proc/sys/vm/overcommit_memory"),
    }
}

/// Reads the mount table and queries the file system.
#[must_use]
pub fn shared(system: &SystemRoot) -> SharedMemoryMount {
    let path = system.path("dev/shm");
    let mounts = system.text("proc/self/mountinfo").unwrap_or_default();
    let (kind, options) = mount(&mounts, "/dev/shm").unzip();
    let (size, free) = nix::sys::statvfs::statvfs(&path).map_or((0, 0), |found| {
        let bytes = |blocks: u64| blocks.saturating_mul(found.fragment_size());
        (bytes(found.blocks()), bytes(found.blocks_available()))
    });
    let access = nix::unistd::AccessFlags::W_OK | nix::unistd::AccessFlags::X_OK;
    SharedMemoryMount {
        kind,
        options: options.unwrap_or_default(),
        size,
        free,
        writable: nix::unistd::access(&path, access).is_ok(),
    }
}

/// Returns type and options of the last mount at `path`. proc_pid_mountinfo(5): the fifth field is the mount point,
/// the sixth the options; the type follows a dash.
fn mount(text: &str, path: &str) -> Option<(String, Vec<String>)> {
    text.lines().rev().find_map(|line| {
        let mut fields = line.split_whitespace().skip(4);
        if fields.next() != Some(path) {
            return None;
        }
        let options = fields.next()?.split(',').map(str::to_owned).collect();
        let kind = line.split(" - ").nth(1)?.split_whitespace().next()?;
        Some((kind.to_owned(), options))
    })
}

#[cfg(test)]
mod tests {
    use super::super::system::tests::FixtureRoot;
    use super::*;

    #[test]
    fn swap_is_counted() {
        let text = "MemAvailable:  2048 kB\nSwapTotal: 100 kB\nSwapFree: 60 kB\n";
        let recorded = FixtureRoot::new(&[("proc/meminfo", text)]);
        let memory = read(&recorded.system());
        assert_eq!(
            (memory.available, memory.swap, memory.swap_used),
            (Some(2 << 20), 102_400, 40_960)
        );
    }

    #[test]
    fn the_last_mount_at_the_place_counts() {
        let text = "24 23 0:22 / /dev/shm rw,nosuid - tmpfs tmpfs rw\n\
                    25 24 0:23 / /dev/shm rw,noexec,relatime shared:4 - ext4 /dev/sda rw\n";
        let found = mount(text, "/dev/shm");
        let options = ["rw", "noexec", "relatime"].map(str::to_owned).to_vec();
        assert_eq!(found, Some(("ext4".to_owned(), options)));
        assert_eq!(mount(text, "/dev"), None);
    }
}
