//! Receives SIGTERM, SIGINT and, unless it is ignored, SIGHUP by polling, so that shared memory is released before the
//! end. Set up by the main thread before any other thread exists.

use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use rcc_process::signals::ignores_hangup;

/// The termination signals of this process.
#[derive(Debug)]
pub struct Signals {
    descriptor: SignalFd,
}

impl Signals {
    /// Blocks the signals, so that they no longer end the process by themselves. SIGHUP stays ignored under `nohup`: a
    /// blocked signal would be received even so.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn catch() -> Result<Signals, Errno> {
        let mut set: SigSet = [Signal::SIGTERM, Signal::SIGINT].into_iter().collect();
        if !ignores_hangup() {
            set.add(Signal::SIGHUP);
        }
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

#[cfg(test)]
mod tests {
    use std::process::Command;

    use nix::sys::signal::raise;

    use super::*;

    /// Tells the process that the test starts that it is that one.
    const UNDER_NOHUP: &str = "RCC_TEST_UNDER_NOHUP";

    #[test]
    fn a_program_under_nohup_outlives_its_terminal() {
        if std::env::var_os(UNDER_NOHUP).is_some() {
            return survive();
        }
        let output = Command::new("sh")
            .args(["-c", r#"trap "" HUP; exec "$0" "$@""#])
            .arg(std::env::current_exe().expect("this test"))
            .args([
                "--exact",
                "signals::tests::a_program_under_nohup_outlives_its_terminal",
            ])
            .env(UNDER_NOHUP, "1")
            .output();
        let output = output.expect("a shell");
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success() && told.contains("1 passed"),
            "{output:?}"
        );
    }

    /// Sends signals to this thread alone.
    fn survive() {
        let mut signals = Signals::catch().expect("a descriptor");
        raise(Signal::SIGHUP).expect("sent");
        assert_eq!(signals.pending(), None);
        raise(Signal::SIGTERM).expect("sent");
        assert_eq!(signals.pending(), Some(Signal::SIGTERM as i32));
    }
}
