//! One life of a process, told apart from all others: its id together with the moment it began.
//! Run by any thread that may read /proc (not the real-time ones).

use std::fs;

use nix::time::{ClockId, clock_gettime};

use crate::clock::monotonic_ns;

/// Process ids of Linux are below 2^22 (`PID_MAX_LIMIT`), so the id and the start fit into one number.
const PID_BITS: u32 = 22;
/// `USER_HZ`, the unit of `/proc`: 100 on every architecture that this software runs on.
const TICKS_PER_S: u64 = 100;

/// One life of one process: a process id alone is reused, the pair with the start time is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Life {
    /// Process id, below 2^22.
    pub pid: u32,
    /// Start of the process in clock ticks after boot (field 22 of `/proc/<pid>/stat`).
    pub start_time_ticks: u64,
}

impl Life {
    /// The life of the calling process.
    #[must_use]
    pub fn current() -> Life {
        let pid = std::process::id();
        // Without a readable /proc every life starts at 0: still one number per process id.
        let start_time_ticks = stat_of(pid).map_or(0, |stat| stat.start_time_ticks);
        Life {
            pid,
            start_time_ticks,
        }
    }

    /// The number that names this life: start and process id in one, shown as 16 hexadecimal digits.
    #[must_use]
    pub fn incarnation(self) -> u64 {
        (self.start_time_ticks << PID_BITS) | u64::from(self.pid)
    }

    /// The life that a number made by [`Life::incarnation`] names.
    #[must_use]
    pub fn from_incarnation(incarnation: u64) -> Life {
        let pid = (incarnation & ((1 << PID_BITS) - 1)) as u32;
        Life {
            pid,
            start_time_ticks: incarnation >> PID_BITS,
        }
    }

    /// True while this very process runs; a zombie is dead, and so is another process with a reused id.
    #[must_use]
    pub fn is_alive(self) -> bool {
        stat_of(self.pid)
            .is_some_and(|stat| stat.start_time_ticks == self.start_time_ticks && stat.runs)
    }
}

struct Stat {
    start_time_ticks: u64,
    runs: bool,
    /// A dead process too has one, its first, until its parent has waited for it.
    threads: u64,
}

fn stat_of(pid: u32) -> Option<Stat> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // Field 2, the name in parentheses, may itself hold spaces and parentheses: count from the last one.
    let mut fields = text.rsplit_once(')')?.1.split_ascii_whitespace();
    let state = fields.next()?;
    let threads = fields.nth(16)?.parse().ok()?;
    let start_time_ticks = fields.nth(1)?.parse().ok()?;
    Some(Stat {
        start_time_ticks,
        runs: !matches!(state, "Z" | "X" | "x"),
        threads,
    })
}

/// The earliest CLOCK_MONOTONIC time, in nanoseconds, at which the process `pid` may have begun; nothing if it is dead.
/// The kernel counts starts with the time the machine slept and this clock does not, hence the doubt. A killed process
/// some of whose threads are still ending is not dead here: it still holds its files and their locks.
pub(crate) fn started_ns(pid: u32) -> Option<u64> {
    let stat = stat_of(pid).filter(|stat| stat.runs || stat.threads > 1)?;
    let since_boot_ns = stat
        .start_time_ticks
        .saturating_mul(1_000_000_000 / TICKS_PER_S);
    let boot = clock_gettime(ClockId::CLOCK_BOOTTIME).ok()?;
    let boot_ns = (boot.tv_sec() as u64).wrapping_mul(1_000_000_000) + boot.tv_nsec() as u64;
    Some(since_boot_ns.saturating_sub(boot_ns.saturating_sub(monotonic_ns())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_names_the_life_and_back() {
        let life = Life::current();
        assert!(life.is_alive() && life.start_time_ticks > 0);
        assert_eq!(Life::from_incarnation(life.incarnation()), life);
    }

    #[test]
    fn the_same_process_id_with_another_start_is_dead() {
        let life = Life::current();
        assert!(
            !Life {
                start_time_ticks: life.start_time_ticks + 1,
                ..life
            }
            .is_alive()
        );
    }

    #[test]
    fn a_zombie_is_dead() -> std::io::Result<()> {
        let mut child = std::process::Command::new("sleep").arg("600").spawn()?;
        let pid = child.id();
        let life = Life {
            pid,
            start_time_ticks: stat_of(pid).map_or(0, |stat| stat.start_time_ticks),
        };
        assert!(life.is_alive());
        child.kill()?;
        let limit = std::time::Instant::now() + std::time::Duration::from_secs(20);
        while life.is_alive() && std::time::Instant::now() < limit {
            std::thread::yield_now();
        }
        assert!(!life.is_alive(), "not yet waited for, so a zombie: dead");
        child.wait().map(|_| ())
    }
}
