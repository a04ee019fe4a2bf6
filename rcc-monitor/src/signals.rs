//! SIGTERM and SIGINT as something to look at, so that shared memory is given back before the end.
//! Set up by the main thread before there is another one.

use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};

/// The signals that ask us to end.
#[derive(Debug)]
pub struct Signals {
    descriptor: SignalFd,
}

impl Signals {
    /// From now on they end nothing by themselves.
    ///
    /// # Errors
    /// What the system says.
    pub fn catch() -> Result<Signals, Errno> {
        let set: SigSet = [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP]
            .into_iter()
            .collect();
        set.thread_block()?;
        let flags = SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC;
        let descriptor = SignalFd::with_flags(&set, flags)?;
        Ok(Signals { descriptor })
    }

    /// The signal that came, if one did.
    pub fn pending(&mut self) -> Option<i32> {
        let read = self.descriptor.read_signal();
        let found = read.ok().flatten()?;
        i32::try_from(found.ssi_signo).ok()
    }
}
