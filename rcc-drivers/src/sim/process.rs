//! Life and death of a simulator's process: it ends on SIGTERM and SIGINT, and with its parent if asked to.
//! The main thread calls all of it, and waits here for the end.

use nix::errno::Errno;
use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::unistd::{getpid, getppid};

/// The signals that end a simulator, blocked in every thread, taken by [`Stop::wait`].
#[derive(Debug)]
pub struct Stop {
    signals: SigSet,
}

impl Stop {
    /// Blocks the signals; to be called before the first thread starts, so that all threads inherit it.
    ///
    /// With `with_parent` the process also ends when the *thread* that started it ends (that is what
    /// `PR_SET_PDEATHSIG` means): start it from a thread that lives as long as it should.
    ///
    /// # Errors
    /// The system refuses, or the parent is gone already.
    pub fn prepare(with_parent: bool) -> Result<Self, Errno> {
        let signals: SigSet = [Signal::SIGTERM, Signal::SIGINT].into_iter().collect();
        signals.thread_block()?;
        if with_parent {
            let parent = getppid();
            set_pdeathsig(Signal::SIGTERM)?;
            if getppid() != parent {
                return Err(Errno::ESRCH);
            }
        }
        Ok(Self { signals })
    }

    /// Sleeps until one of the signals comes.
    ///
    /// # Errors
    /// The system refuses.
    pub fn wait(&self) -> Result<Signal, Errno> {
        self.signals.wait()
    }
}

/// Ends this process in the same way as a SIGTERM from outside.
pub fn request_stop() {
    if let Err(error) = kill(getpid(), Signal::SIGTERM) {
        tracing::error!(%error, "the process cannot signal itself");
    }
}
