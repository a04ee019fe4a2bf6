//! Tries what the executor needs: SCHED_FIFO on a thread, and locked memory; both are released again. Run by the main
//! thread; SCHED_FIFO is tried on a separate thread.

use std::thread;

use nix::errno::Errno;
use nix::sys::mman::{MlockAllFlags, mlockall, munlockall};
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Results of the trials, with the system's error if refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trial {
    /// SCHED_FIFO with the configured priority.
    pub fifo: Result<(), Errno>,
    /// Locking all current and future memory of this process.
    pub lock: Result<(), Errno>,
}

impl Default for Trial {
    fn default() -> Self {
        Trial {
            fifo: Ok(()),
            lock: Ok(()),
        }
    }
}

/// Runs all trials.
#[must_use]
pub fn try_all(priority: u8) -> Trial {
    let fifo = thread::Builder::new()
        .spawn(move || become_fifo(priority))
        .map_err(|_| Errno::EAGAIN)
        .and_then(|thread| thread.join().unwrap_or(Err(Errno::EINVAL)));
    let lock = mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE);
    // munlockall only releases what was locked; a failure changes nothing.
    let _ = munlockall();
    Trial { fifo, lock }
}

/// Switches the calling thread to SCHED_FIFO.
///
/// # Errors
/// Returns the system's error.
pub fn become_fifo(priority: u8) -> Result<(), Errno> {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority)
        .map(ThreadPriority::Crossplatform)
        .map_err(|_| Errno::EINVAL)?;
    set_thread_priority_and_policy(thread_native_id(), value, policy).map_err(|error| match error {
        Error::OS(number) => Errno::from_raw(number),
        _ => Errno::EINVAL,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trial_leaves_this_thread_as_it_was() {
        let policy = || thread_priority::thread_schedule_policy().ok();
        let before = policy();
        let _ = try_all(1);
        assert_eq!(policy(), before);
    }

    #[test]
    fn a_priority_that_does_not_exist_is_refused() {
        assert_eq!(try_all(200).fifo, Err(Errno::EINVAL));
    }
}
