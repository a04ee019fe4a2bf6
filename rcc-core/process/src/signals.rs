//! Life and death of a program: it ends on SIGTERM and SIGINT, and with its parent if asked to.
//! The main thread calls all of it; one thread waits for the end.

use std::time::Duration;

use nix::errno::Errno;
use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::unistd::{Pid, getpid, getppid};

/// The signals that end a program.
fn stop_signals() -> SigSet {
    [Signal::SIGTERM, Signal::SIGINT].into_iter().collect()
}

/// The signals that end a program, blocked in every thread, taken by [`Stop::wait`].
#[derive(Debug)]
pub struct Stop {
    /// Open from the start: to wait needs nothing that could be missing then.
    signals: SignalFd,
}

/// Pause before signals that could not be read are read again.
const READ_AGAIN: Duration = Duration::from_millis(100);

/// The program cannot be ended as it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignalError {
    /// The system refuses.
    #[error("the system refuses signals: {0}")]
    System(#[from] Errno),
    /// Whoever started this program is dead already.
    #[error("the parent process is dead, and --parent-death was given")]
    Orphan,
}

impl Stop {
    /// Blocks the signals; to be called before the first thread starts, so that all threads inherit it.
    ///
    /// With `with_parent` the process also ends when the *thread* that started it ends (that is what
    /// `PR_SET_PDEATHSIG` means): start it from a thread that lives as long as it should.
    ///
    /// # Errors
    /// The system refuses, or the parent is gone already.
    pub fn prepare(with_parent: bool) -> Result<Self, SignalError> {
        let signals = stop_signals();
        signals.thread_block()?;
        if with_parent {
            end_with_parent()?;
        }
        let signals = SignalFd::with_flags(&signals, SfdFlags::SFD_CLOEXEC)?;
        Ok(Self { signals })
    }

    /// Sleeps until one of the signals comes. They stay pending while they cannot be read: that is told, and tried again.
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
                    tracing::warn!("signals cannot be read ({error}); tried again");
                    std::thread::sleep(READ_AGAIN);
                }
            }
        }
    }
}

/// For a program that handles these signals itself: lets them through in this thread and in those that it starts. A
/// program inherits what its parent has blocked, and could not be asked to end.
///
/// # Errors
/// The system refuses.
pub fn unblock_stop_signals() -> Result<(), SignalError> {
    Ok(stop_signals().thread_unblock()?)
}

/// In the environment: the process id of whoever started this program, if it says so.
pub const PARENT: &str = "RCC_PARENT_PID";

/// Asks for SIGTERM at the parent's death, and looks whether it is dead already: also when it died before this program's
/// first instruction, if it said who it is ([`PARENT`]).
///
/// # Errors
/// The system refuses, or the parent is gone already.
pub fn end_with_parent() -> Result<(), SignalError> {
    let told = std::env::var(PARENT)
        .ok()
        .and_then(|text| text.parse().ok());
    let parent = told.map_or_else(getppid, Pid::from_raw);
    set_pdeathsig(Signal::SIGTERM)?;
    if getppid() != parent {
        return Err(SignalError::Orphan);
    }
    Ok(())
}

/// Ends this process in the same way as a SIGTERM from outside.
pub fn request_stop() {
    if let Err(error) = kill(getpid(), Signal::SIGTERM) {
        tracing::error!(%error, "the process cannot signal itself");
    }
}

/// Ends this process as SIGTERM does when the thread that holds it panics: without that thread it would only seem to work.
#[derive(Debug)]
pub struct StopsAtPanic;

impl Drop for StopsAtPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            request_stop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_parent_has_blocked_is_let_through() -> Result<(), SignalError> {
        // The mask is the thread's, so no other test sees it.
        stop_signals().thread_block()?;
        assert!(SigSet::thread_get_mask()?.contains(Signal::SIGTERM));
        unblock_stop_signals()?;
        let mask = SigSet::thread_get_mask()?;
        assert!(!mask.contains(Signal::SIGTERM) && !mask.contains(Signal::SIGINT));
        Ok(())
    }
}
