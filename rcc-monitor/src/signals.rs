//! Receives SIGTERM, SIGINT and SIGHUP by polling, so that shared memory is released before the end. Set up by the main
//! thread before any other thread exists.

use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};

/// The termination signals of this process.
#[derive(Debug)]
pub struct Signals {
    descriptor: SignalFd,
}

impl Signals {
    /// Blocks the signals, so that they no longer end the process by themselves.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn catch() -> Result<Signals, Errno> {
        let set: SigSet = [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP]
            .into_iter()
            .collect();
        set.thread_block()?;
        let flags = SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC;
        let descriptor = SignalFd::with_flags(&set, flags)?;
        Ok(Signals { descriptor })
    }

    /// Returns the number of a pending signal, if there is one.
    pub fn pending(&mut self) -> Option<i32> {
        let read = self.descriptor.read_signal();
        let found = read.ok().flatten()?;
        i32::try_from(found.ssi_signo).ok()
    }
}
