//! Scheduling of a thread: SCHED_FIFO where the system permits it, otherwise the default policy.
//! Called once at its start by the thread concerned.

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Requests SCHED_FIFO with this priority (1 to 99) for the calling thread, and logs whether it was granted.
pub fn set_realtime_priority(priority: u8) {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority).map(ThreadPriority::Crossplatform);
    let result =
        value.map(|value| set_thread_priority_and_policy(thread_native_id(), value, policy));
    match result {
        Ok(Ok(())) => tracing::info!(priority, "runs with SCHED_FIFO"),
        refused => tracing::warn!(
            priority,
            "runs without SCHED_FIFO ({refused:?}): permit it with `ulimit -r` or CAP_SYS_NICE"
        ),
    }
}
