//! One incarnation of a process, identified by its process id and start time. Runs on threads that may read /proc (not
//! the real-time ones).

use std::fs::File;
use std::io::{self, Read};
use std::sync::atomic::{AtomicU64, Ordering};

use nix::errno::Errno;
use nix::sys::signal::kill;
use nix::time::{ClockId, clock_gettime};
use nix::unistd::Pid;

use crate::clock::monotonic_ns;

/// Process ids of Linux are below 2^22 (`PID_MAX_LIMIT`), so process id and start time fit into one number.
const PID_BITS: u32 = 22;
/// Cached [`ProcessInstance::incarnation`] of this process, 0 until it is known: later calls need not open a file.
static OWN: AtomicU64 = AtomicU64::new(0);
/// `USER_HZ`, the unit of `/proc`: 100 on every architecture that this software runs on.
const TICKS_PER_S: u64 = 100;

/// One incarnation of a process. A process id alone is reused; together with the start time it is unique.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProcessInstance {
    /// Process id, below 2^22.
    pub pid: u32,
    /// Start of the process in clock ticks after boot (field 22 of `/proc/<pid>/stat`).
    pub start_time_ticks: u64,
}

impl ProcessInstance {
    /// Returns the instance of the calling process.
    ///
    /// # Errors
    /// Returns an error if `/proc/self/stat` cannot be read: without its start time a process cannot be told from a
    /// later one with the same id.
    pub fn current() -> io::Result<ProcessInstance> {
        let pid = std::process::id();
        // Relaxed: the number is self-contained. A forked child finds the value of its parent, which has another
        // process id.
        let known = ProcessInstance::from_incarnation(OWN.load(Ordering::Relaxed));
        if known.pid == pid {
            return Ok(known);
        }
        let stat = stat_of(pid)?.ok_or(Errno::ESRCH)?;
        let instance = ProcessInstance {
            pid,
            start_time_ticks: stat.start_time_ticks,
        };
        OWN.store(instance.incarnation(), Ordering::Relaxed);
        Ok(instance)
    }

    /// Returns the incarnation number: start time and process id in one, displayed as 16 hexadecimal digits.
    #[must_use]
    pub fn incarnation(self) -> u64 {
        (self.start_time_ticks << PID_BITS) | u64::from(self.pid)
    }

    /// Returns the instance that an incarnation number identifies.
    #[must_use]
    pub fn from_incarnation(incarnation: u64) -> ProcessInstance {
        let pid = (incarnation & ((1 << PID_BITS) - 1)) as u32;
        ProcessInstance {
            pid,
            start_time_ticks: incarnation >> PID_BITS,
        }
    }

    /// Returns whether this process instance runs. A zombie counts as dead, and so does an instance whose process id
    /// now belongs to another process. If the system cannot tell (no free descriptor, no memory, no permission) the
    /// result is [`Liveness::Unknown`]: act only on [`Liveness::Dead`]; report `Unknown` and ask again.
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

/// Result of a liveness check. Deliberately not a `bool`: "not known to be alive" is not "dead".
#[derive(Debug)]
pub enum Liveness {
    /// The process runs.
    Alive,
    /// The process is gone: no such process, a zombie, or another process under the same id.
    Dead,
    /// The system could not tell, for this reason.
    Unknown(io::Error),
}

impl Liveness {
    /// Returns true if the process is known to run.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        matches!(self, Liveness::Alive)
    }

    /// Returns true if the process is known to be gone.
    #[must_use]
    pub fn is_dead(&self) -> bool {
        matches!(self, Liveness::Dead)
    }
}

/// More bytes than `/proc/<pid>/stat` has: 52 numbers and a name of at most 64 bytes.
const STAT_MAX: usize = 2048;

struct Stat {
    start_time_ticks: u64,
    runs: bool,
    /// A dead process still counts its first thread until its parent has waited for it.
    threads: u64,
}

/// Returns the kernel's data about process `pid`, or `None` if there is no such process. Only ESRCH proves that: an
/// open that fails for another reason says nothing about the process.
fn stat_of(pid: u32) -> io::Result<Option<Stat>> {
    // First, because it needs no descriptor: a death is detected even if no file can be opened.
    if !exists(pid)? {
        return Ok(None);
    }
    let path = format!("/proc/{pid}/stat");
    match read_stat(&path) {
        Ok(text) => match parse(&text) {
            Some(stat) => Ok(Some(stat)),
            None => Err(io::Error::new(
                io::ErrorKind::InvalidData,
                format!("{path} has an unknown format"),
            )),
        },
        // The process ended after the first check; or /proc is not mounted or hides it.
        Err(error) if exists(pid)? => Err(io::Error::new(error.kind(), format!("{path}: {error}"))),
        Err(_) => Ok(None),
    }
}

/// Reads the line at once, because the kernel makes it anew for every piece that is read.
fn read_stat(path: &str) -> io::Result<String> {
    let mut line = [0; STAT_MAX];
    let length = File::open(path)?.read(&mut line)?;
    Ok(String::from_utf8_lossy(&line[..length]).into_owned())
}

/// Returns whether the kernel knows a process with this id, running or not yet waited for.
fn exists(pid: u32) -> io::Result<bool> {
    // 0 and negative numbers name process groups.
    let Some(pid) = i32::try_from(pid).ok().filter(|pid| *pid > 0) else {
        return Ok(false);
    };
    match kill(Pid::from_raw(pid), None) {
        // EPERM: the process exists and belongs to another user.
        Ok(()) | Err(Errno::EPERM) => Ok(true),
        Err(Errno::ESRCH) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

fn parse(text: &str) -> Option<Stat> {
    // Field 2, the name in parentheses, may itself contain spaces and parentheses: count from the last one.
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

/// Returns the earliest CLOCK_MONOTONIC time, ns, at which process `pid` may have started; `None` if it is dead. The
/// kernel counts start times including suspend and this clock does not, so the result is a lower bound. A killed
/// process with threads that are still ending does not count as dead: it still holds its files and their locks.
///
/// # Errors
/// Returns an error if the system cannot tell whether the process exists or when it started.
pub fn started_ns(pid: u32) -> io::Result<Option<u64>> {
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

    /// Set in the child process in which the test runs itself again.
    const INSIDE: &str = "RCC_LIFE_INSIDE";

    #[test]
    fn an_incarnation_number_converts_back() -> io::Result<()> {
        let instance = ProcessInstance::current()?;
        assert!(instance.liveness().is_alive() && instance.start_time_ticks > 0);
        assert_eq!(
            ProcessInstance::from_incarnation(instance.incarnation()),
            instance
        );
        Ok(())
    }

    #[test]
    fn the_same_process_id_with_another_start_time_is_dead() -> io::Result<()> {
        let instance = ProcessInstance::current()?;
        let other = ProcessInstance {
            start_time_ticks: instance.start_time_ticks + 1,
            ..instance
        };
        assert!(other.liveness().is_dead());
        Ok(())
    }

    #[test]
    fn an_id_that_no_process_can_have_is_dead() {
        for pid in [0, 1 << 31, u32::MAX] {
            let instance = ProcessInstance {
                pid,
                start_time_ticks: 0,
            };
            assert!(instance.liveness().is_dead(), "{pid}");
        }
    }

    #[test]
    fn a_zombie_is_dead() -> io::Result<()> {
        let mut child = std::process::Command::new("sleep").arg("600").spawn()?;
        let pid = child.id();
        let instance = ProcessInstance {
            pid,
            start_time_ticks: stat_of(pid)?.map_or(0, |stat| stat.start_time_ticks),
        };
        assert!(instance.liveness().is_alive());
        child.kill()?;
        let limit = std::time::Instant::now() + std::time::Duration::from_secs(20);
        while instance.liveness().is_alive() && std::time::Instant::now() < limit {
            std::thread::yield_now();
        }
        assert!(
            instance.liveness().is_dead(),
            "not yet waited for, so a zombie"
        );
        child.wait().map(|_| ())
    }

    /// The limit is per process, so the test runs in a process of its own.
    #[test]
    fn without_a_free_descriptor_liveness_is_unknown_and_death_is_still_detected() -> io::Result<()>
    {
        use nix::sys::resource::{Resource, getrlimit, setrlimit};
        let mut child = std::process::Command::new("sleep").arg("600").spawn()?;
        if std::env::var_os(INSIDE).is_none() {
            let test = "process_instance::tests::without_a_free_descriptor_liveness_is_unknown_and_death_is_still_detected";
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
        let instance = ProcessInstance {
            pid,
            start_time_ticks,
        };
        let (_, hard) = getrlimit(Resource::RLIMIT_NOFILE)?;
        setrlimit(Resource::RLIMIT_NOFILE, 0, hard)?;
        let living = instance.liveness();
        let started = started_ns(pid);
        child.kill()?;
        child.wait()?;
        let dead = instance.liveness();
        setrlimit(Resource::RLIMIT_NOFILE, hard, hard)?;
        assert!(matches!(living, Liveness::Unknown(_)), "{living:?}");
        assert!(started.is_err(), "{started:?}");
        assert!(dead.is_dead(), "{dead:?}");
        Ok(())
    }
}
