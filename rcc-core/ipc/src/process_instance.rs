//! One life of a process, told apart from all others: its id together with the moment it began.
//! Run by any thread that may read /proc (not the real-time ones).

use std::fs;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use nix::errno::Errno;
use nix::sys::signal::kill;
use nix::time::{ClockId, clock_gettime};
use nix::unistd::Pid;

use crate::clock::monotonic_ns;

/// Process ids of Linux are below 2^22 (`PID_MAX_LIMIT`), so the id and the start fit into one number.
const PID_BITS: u32 = 22;
/// [`ProcessInstance::incarnation`] of this process once it is known, else 0: afterwards nothing has to be opened for it.
static OWN: AtomicU64 = AtomicU64::new(0);
/// `USER_HZ`, the unit of `/proc`: 100 on every architecture that this software runs on.
const TICKS_PER_S: u64 = 100;

/// One life of one process: a process id alone is reused, the pair with the start time is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProcessInstance {
    /// Process id, below 2^22.
    pub pid: u32,
    /// Start of the process in clock ticks after boot (field 22 of `/proc/<pid>/stat`).
    pub start_time_ticks: u64,
}

impl ProcessInstance {
    /// The life of the calling process.
    ///
    /// # Errors
    /// `/proc/self/stat` cannot be read: without its start time a process cannot be told from a later one with the same id.
    pub fn current() -> io::Result<ProcessInstance> {
        let pid = std::process::id();
        // Relaxed: the number is all there is. A forked child finds its parent's, which has another process id.
        let known = ProcessInstance::from_incarnation(OWN.load(Ordering::Relaxed));
        if known.pid == pid {
            return Ok(known);
        }
        let stat = stat_of(pid)?.ok_or(Errno::ESRCH)?;
        let life = ProcessInstance {
            pid,
            start_time_ticks: stat.start_time_ticks,
        };
        OWN.store(life.incarnation(), Ordering::Relaxed);
        Ok(life)
    }

    /// The number that names this life: start and process id in one, shown as 16 hexadecimal digits.
    #[must_use]
    pub fn incarnation(self) -> u64 {
        (self.start_time_ticks << PID_BITS) | u64::from(self.pid)
    }

    /// The life that a number made by [`ProcessInstance::incarnation`] names.
    #[must_use]
    pub fn from_incarnation(incarnation: u64) -> ProcessInstance {
        let pid = (incarnation & ((1 << PID_BITS) - 1)) as u32;
        ProcessInstance {
            pid,
            start_time_ticks: incarnation >> PID_BITS,
        }
    }

    /// Whether this very process runs. A zombie is dead, and so is a life whose process id belongs to another process by
    /// now. What cannot be found out (no descriptor is free, no memory, no permission) is neither: act on
    /// [`Liveness::Dead`] only, report [`Liveness::Unknown`] and look again.
    #[must_use]
    pub fn liveness(self) -> Liveness {
        match stat_of(self.pid) {
            Ok(Some(stat)) if stat.start_time_ticks == self.start_time_ticks && stat.runs => {
                Liveness::Alive
            }
            Ok(_) => Liveness::Dead,
            Err(error) => Liveness::Unknown(error),
        }
    }
}

/// What is known about a life. There is no truth value in it on purpose: "not known to be alive" is not "dead".
#[derive(Debug)]
pub enum Liveness {
    /// The process runs.
    Alive,
    /// The process is gone: no such process, a zombie, or another process under the same id.
    Dead,
    /// The system did not tell: why not.
    Unknown(io::Error),
}

impl Liveness {
    /// True if the process is known to run.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        matches!(self, Liveness::Alive)
    }

    /// True if the process is known to be gone.
    #[must_use]
    pub fn is_dead(&self) -> bool {
        matches!(self, Liveness::Dead)
    }
}

struct Stat {
    start_time_ticks: u64,
    runs: bool,
    /// A dead process too has one, its first, until its parent has waited for it.
    threads: u64,
}

/// What the kernel says about the process `pid`; nothing if there is no such process. Only the kernel's own word for that
/// counts, ESRCH: an open that fails for another reason says nothing about the process.
fn stat_of(pid: u32) -> io::Result<Option<Stat>> {
    // First, because it needs no descriptor: a death is seen even where nothing can be opened.
    if !exists(pid)? {
        return Ok(None);
    }
    let path = format!("/proc/{pid}/stat");
    match fs::read_to_string(&path) {
        Ok(text) => match parse(&text) {
            Some(stat) => Ok(Some(stat)),
            None => Err(io::Error::new(
                io::ErrorKind::InvalidData,
                format!("{path} has an unknown form"),
            )),
        },
        // It ended after the first look; or /proc is not mounted, or hides it.
        Err(error) if exists(pid)? => Err(io::Error::new(error.kind(), format!("{path}: {error}"))),
        Err(_) => Ok(None),
    }
}

/// Whether the kernel knows a process of this id, running or not yet waited for.
fn exists(pid: u32) -> io::Result<bool> {
    // 0 and negative numbers name groups, not processes.
    let Some(pid) = i32::try_from(pid).ok().filter(|pid| *pid > 0) else {
        return Ok(false);
    };
    match kill(Pid::from_raw(pid), None) {
        // Not permitted: there is one, of another user.
        Ok(()) | Err(Errno::EPERM) => Ok(true),
        Err(Errno::ESRCH) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

fn parse(text: &str) -> Option<Stat> {
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
///
/// # Errors
/// The system does not tell whether there is such a process, or when it began.
pub(crate) fn started_ns(pid: u32) -> io::Result<Option<u64>> {
    let Some(stat) = stat_of(pid)?.filter(|stat| stat.runs || stat.threads > 1) else {
        return Ok(None);
    };
    let since_boot_ns = stat
        .start_time_ticks
        .saturating_mul(1_000_000_000 / TICKS_PER_S);
    let boot = clock_gettime(ClockId::CLOCK_BOOTTIME)?;
    let boot_ns = (boot.tv_sec() as u64).wrapping_mul(1_000_000_000) + boot.tv_nsec() as u64;
    let slept_ns = boot_ns.saturating_sub(monotonic_ns());
    Ok(Some(since_boot_ns.saturating_sub(slept_ns)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Set in the process that a test starts from its own program, to run one test in it.
    const INSIDE: &str = "RCC_LIFE_INSIDE";

    #[test]
    fn the_number_names_the_life_and_back() -> io::Result<()> {
        let life = ProcessInstance::current()?;
        assert!(life.liveness().is_alive() && life.start_time_ticks > 0);
        assert_eq!(ProcessInstance::from_incarnation(life.incarnation()), life);
        Ok(())
    }

    #[test]
    fn the_same_process_id_with_another_start_is_dead() -> io::Result<()> {
        let life = ProcessInstance::current()?;
        let other = ProcessInstance {
            start_time_ticks: life.start_time_ticks + 1,
            ..life
        };
        assert!(other.liveness().is_dead());
        Ok(())
    }

    #[test]
    fn an_id_that_no_process_can_have_is_dead() {
        for pid in [0, 1 << 31, u32::MAX] {
            let life = ProcessInstance {
                pid,
                start_time_ticks: 0,
            };
            assert!(life.liveness().is_dead(), "{pid}");
        }
    }

    #[test]
    fn a_zombie_is_dead() -> io::Result<()> {
        let mut child = std::process::Command::new("sleep").arg("600").spawn()?;
        let pid = child.id();
        let life = ProcessInstance {
            pid,
            start_time_ticks: stat_of(pid)?.map_or(0, |stat| stat.start_time_ticks),
        };
        assert!(life.liveness().is_alive());
        child.kill()?;
        let limit = std::time::Instant::now() + std::time::Duration::from_secs(20);
        while life.liveness().is_alive() && std::time::Instant::now() < limit {
            std::thread::yield_now();
        }
        assert!(life.liveness().is_dead(), "not yet waited for, so a zombie");
        child.wait().map(|_| ())
    }

    /// The limit is the process', so the test runs in one of its own.
    #[test]
    fn without_a_free_descriptor_a_life_is_unknown_and_a_death_is_still_seen() -> io::Result<()> {
        use nix::sys::resource::{Resource, getrlimit, setrlimit};
        let mut child = std::process::Command::new("sleep").arg("600").spawn()?;
        if std::env::var_os(INSIDE).is_none() {
            let test = "process_instance::tests::without_a_free_descriptor_a_life_is_unknown_and_a_death_is_still_seen";
            let inside = std::process::Command::new(std::env::current_exe()?)
                .args([test, "--exact"])
                .env(INSIDE, "1")
                .output()?;
            child.kill()?;
            child.wait()?;
            let words = String::from_utf8_lossy(&inside.stdout).into_owned();
            assert!(
                inside.status.success() && words.contains("1 passed"),
                "{words}"
            );
            return Ok(());
        }
        let pid = child.id();
        let start_time_ticks = stat_of(pid)?.map_or(0, |stat| stat.start_time_ticks);
        let life = ProcessInstance {
            pid,
            start_time_ticks,
        };
        let (_, hard) = getrlimit(Resource::RLIMIT_NOFILE)?;
        setrlimit(Resource::RLIMIT_NOFILE, 0, hard)?;
        let living = life.liveness();
        let started = started_ns(pid);
        child.kill()?;
        child.wait()?;
        let dead = life.liveness();
        setrlimit(Resource::RLIMIT_NOFILE, hard, hard)?;
        assert!(matches!(living, Liveness::Unknown(_)), "{living:?}");
        assert!(started.is_err(), "{started:?}");
        assert!(dead.is_dead(), "{dead:?}");
        Ok(())
    }
}
