//! Signals that end a program: SIGTERM, SIGINT, and the death of its parent if requested. Used by the main thread; one
//! thread waits for the signal.

use std::time::Duration;

use nix::errno::Errno;
use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::unistd::{Pid, getpid, getppid};

/// Returns the signals that end a program.
fn stop_signals() -> SigSet {
    [Signal::SIGTERM, Signal::SIGINT].into_iter().collect()
}

/// The signals that end a program, blocked in every thread and taken by [`Stop::wait`].
#[derive(Debug)]
pub struct Stop {
    /// Opened at the start, so that waiting needs no resource that could be missing then.
    signals: SignalFd,
}

/// Pause before another attempt to read signals.
const READ_AGAIN: Duration = Duration::from_millis(100);

/// The signals cannot be set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignalError {
    /// Error from the system.
    #[error("cannot set up signals: {0}")]
    System(#[from] Errno),
    /// The parent process is already dead.
    #[error("the parent process is dead, and --parent-death was given")]
    Orphan,
}

impl Stop {
    /// Blocks the signals. Call it before the first thread starts, so that all threads inherit the mask.
    ///
    /// With `with_parent` the process also ends when the *thread* that started it ends (the meaning of
    /// `PR_SET_PDEATHSIG`): start it from a thread that lives long enough.
    ///
    /// # Errors
    /// Returns an error if the system refuses, or if the parent is already dead.
    pub fn prepare(with_parent: bool) -> Result<Self, SignalError> {
        let signals = stop_signals();
        signals.thread_block()?;
        if with_parent {
            end_with_parent()?;
        }
        let signals = SignalFd::with_flags(&signals, SfdFlags::SFD_CLOEXEC)?;
        Ok(Self { signals })
    }

    /// Sleeps until one of the signals arrives. If signals cannot be read they stay pending; this logs a warning and
    /// tries again.
    pub fn wait(&self) -> Signal {
        loop {
            match self.signals.read_signal() {
                Ok(Some(found)) => {
                    if let Ok(signal) = Signal::try_from(found.ssi_signo.cast_signed()) {
                        return signal;
                    }
                }
                Ok(None) | Err(Errno::EINTR) => {}
                Err(error) => {
                    tracing::warn!("cannot read signals ({error}); trying again");
                    std::thread::sleep(READ_AGAIN);
                }
            }
        }
    }
}

/// Unblocks these signals in this thread and in threads that it starts, for a program that handles them itself. A
/// program inherits the mask of its parent; with blocked signals it could not be asked to end.
///
/// # Errors
/// Returns an error if the system refuses.
pub fn unblock_stop_signals() -> Result<(), SignalError> {
    Ok(stop_signals().thread_unblock()?)
}

/// Environment variable with the process id of the parent, if the parent sets it.
pub const PARENT: &str = "RCC_PARENT_PID";

/// Requests SIGTERM at the death of the parent and checks that it is not already dead. With [`PARENT`] this also
/// detects a parent that died before this program's first instruction.
///
/// # Errors
/// Returns an error if the system refuses, or if the parent is already dead.
pub fn end_with_parent() -> Result<(), SignalError> {
    let given = std::env::var(PARENT)
        .ok()
        .and_then(|text| text.parse().ok());
    let parent = given.map_or_else(getppid, Pid::from_raw);
    set_pdeathsig(Signal::SIGTERM)?;
    if getppid() != parent {
        return Err(SignalError::Orphan);
    }
    Ok(())
}

/// Ends this process like a SIGTERM from outside.
pub fn request_stop() {
    if let Err(error) = kill(getpid(), Signal::SIGTERM) {
        tracing::error!(%error, "the process cannot signal itself");
    }
}

/// Ends this process like SIGTERM if the thread that holds this value panics: without that thread the process would
/// only appear to work.
#[derive(Debug)]
pub struct StopsAtPanic;

impl Drop for StopsAtPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            request_stop();
        }
    }
}

/// Returns true if this process ignores SIGHUP since its start, as under `nohup`; then the end of a terminal must not end
/// it.
#[must_use]
pub fn ignores_hangup() -> bool {
    std::fs::read_to_string("/proc/self/status")
        .is_ok_and(|status| ignores(&status, Signal::SIGHUP))
}

/// Returns true if the signal is ignored, by the `SigIgn` of proc_pid_status(5): a mask in hexadecimal digits, with signal
/// 1 in its lowest bit.
fn ignores(status: &str, signal: Signal) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal as u32 - 1) & 1 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ignored_signals_are_a_mask() {
        let status = "Name:\trcc-cli\nSigBlk:\t0000000000000001\nSigIgn:\t0000000000001001\n";
        assert!(ignores(status, Signal::SIGHUP) && ignores(status, Signal::SIGPIPE));
        assert!(!ignores(status, Signal::SIGTERM) && !ignores("", Signal::SIGHUP));
    }

    #[test]
    fn signals_blocked_by_a_parent_are_unblocked() -> Result<(), SignalError> {
        // The mask is per thread, so no other test sees it.
        stop_signals().thread_block()?;
        assert!(SigSet::thread_get_mask()?.contains(Signal::SIGTERM));
        unblock_stop_signals()?;
        let mask = SigSet::thread_get_mask()?;
        assert!(!mask.contains(Signal::SIGTERM) && !mask.contains(Signal::SIGINT));
        Ok(())
    }
}
