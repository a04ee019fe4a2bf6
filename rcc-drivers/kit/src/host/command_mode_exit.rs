//! The end of command mode before a driver ends: the device must have left it for good, because a controller that waits
//! for answers in command mode stops the arm with a fault. Pure; run by the host's thread.

/// How long exchanges continue after the device has been asked to leave command mode, ns.
const TIMEOUT_NS: u64 = 1_000_000_000;
/// Consecutive exchanges outside of command mode after which the device is taken to have left it: an earlier request to
/// enter may still take effect, for example in the next pass of a KRL program (12 ms).
const EXCHANGES: u32 = 20;

/// The wait for a device that has been asked to leave command mode.
#[derive(Clone, Copy, Debug)]
pub struct CommandModeExit {
    requested_ns: u64,
    /// Consecutive exchanges outside of command mode.
    outside: u32,
}

impl CommandModeExit {
    /// Starts the wait at this time on CLOCK_MONOTONIC.
    #[must_use]
    pub fn requested(now_ns: u64) -> CommandModeExit {
        CommandModeExit {
            requested_ns: now_ns,
            outside: 0,
        }
    }

    /// Takes an exchange into account; `commandable` is true in command mode.
    pub fn observe(&mut self, commandable: bool) {
        self.outside = if commandable { 0 } else { self.outside + 1 };
    }

    /// Returns true if the device has left command mode, or had the time to do so.
    #[must_use]
    pub fn is_over(&self, now_ns: u64) -> bool {
        self.outside >= EXCHANGES || now_ns.saturating_sub(self.requested_ns) > TIMEOUT_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exchanges_outside_of_command_mode_must_follow_each_other() {
        let mut exit = CommandModeExit::requested(0);
        (1..EXCHANGES).for_each(|_| exit.observe(false));
        assert!(!exit.is_over(1));
        exit.observe(true);
        (1..EXCHANGES).for_each(|_| exit.observe(false));
        assert!(!exit.is_over(1));
        exit.observe(false);
        assert!(exit.is_over(1));
    }

    #[test]
    fn a_device_that_does_not_leave_is_waited_for_for_a_second() {
        let mut exit = CommandModeExit::requested(5);
        exit.observe(true);
        assert!(!exit.is_over(5 + TIMEOUT_NS));
        assert!(exit.is_over(6 + TIMEOUT_NS));
    }
}
