//! Scheduling of the threads that a CANCEL or ABORT passes: they run before the threads that load, check and list, and
//! before other programs of the same core. Each thread raises itself at its start.

use std::io;

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Real-time priority of the threads that carry out a CANCEL or ABORT: below each thread of a driver and of the cycle.
pub const STOP_PRIORITY: u8 = 1;

/// Requests SCHED_RR with [`STOP_PRIORITY`] for the calling thread, which then is not kept from its processor by a
/// program that computes; otherwise [`STOP_NICE`]. The log says what was refused.
pub fn raise_stop_thread() {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
    let granted = ThreadPriorityValue::try_from(STOP_PRIORITY).is_ok_and(|value| {
        let value = ThreadPriority::Crossplatform(value);
        set_thread_priority_and_policy(thread_native_id(), value, policy).is_ok()
    });
    if granted {
        return;
    }
    tracing::info!(
        "CANCEL and ABORT wait for programs that compute: SCHED_RR {STOP_PRIORITY} was refused: raise the limit `rtprio` \
         (LimitRTPRIO={STOP_PRIORITY})"
    );
    let _ = WorkerPriority::raise_calling_thread();
}

/// Nice value of these threads (of the loader `front` and the threads of CANCEL and ABORT, of the executor the intake
/// thread) without that permission, and of the loader's thread that serves all other requests.
pub const STOP_NICE: i32 = -10;

/// The nice value that the program was started with, which the worker threads keep.
#[derive(Clone, Copy, Debug)]
pub struct WorkerPriority(i32);

impl WorkerPriority {
    /// Raises the calling thread, and the threads that it creates from now on, to [`STOP_NICE`].
    ///
    /// # Errors
    /// Returns an error if the system refuses; the nice value is unchanged then.
    pub fn raise_calling_thread() -> io::Result<WorkerPriority> {
        let started_with = rustix::process::getpriority_process(None)?;
        if started_with > STOP_NICE {
            rustix::process::setpriority_process(None, STOP_NICE)?;
        }
        Ok(WorkerPriority(started_with))
    }

    /// Gives the calling thread, which a raised thread created, the nice value of the workers.
    pub fn apply(self) {
        // A thread may always lower itself.
        let _ = rustix::process::setpriority_process(None, self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nice() -> i32 {
        rustix::process::getpriority_process(None).expect("the thread exists")
    }

    #[test]
    fn a_stop_thread_runs_before_what_computes_or_stays_as_it_was() {
        let before = nice();
        let raised = std::thread::spawn(|| {
            raise_stop_thread();
            (thread_priority::thread_schedule_policy(), nice())
        });
        let (policy, nice) = raised.join().expect("no panic");
        let round_robin = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
        match policy.expect("the thread exists") == round_robin {
            true => assert_eq!(nice, before),
            false => assert!(nice == before || nice == STOP_NICE, "{nice}"),
        }
        let policy = thread_priority::thread_schedule_policy().expect("the thread exists");
        assert_ne!(policy, round_robin, "only the calling thread is raised");
    }

    #[test]
    fn workers_keep_the_value_that_the_program_was_started_with() {
        let before = nice();
        let serving = std::thread::spawn(move || {
            let Ok(workers) = WorkerPriority::raise_calling_thread() else {
                // Not permitted here: nothing may have changed.
                return assert_eq!(nice(), before);
            };
            assert_eq!(nice(), before.min(STOP_NICE));
            let worker = std::thread::spawn(move || {
                assert_eq!(nice(), before.min(STOP_NICE), "inherited");
                workers.apply();
                nice()
            });
            assert_eq!(worker.join().expect("no panic"), before);
        });
        serving.join().expect("no panic");
        assert_eq!(nice(), before, "only the calling thread is raised");
    }
}
