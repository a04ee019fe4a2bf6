//! A thread's place among all others: SCHED_FIFO where the system grants it, the usual one otherwise.
//! Called by the thread that wants it, once, at its start.

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// SCHED_FIFO with this priority (1 to 99) for the calling thread; says what was obtained.
pub fn rise(priority: u8) {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority).map(ThreadPriority::Crossplatform);
    let result =
        value.map(|value| set_thread_priority_and_policy(thread_native_id(), value, policy));
    match result {
        Ok(Ok(())) => tracing::info!(priority, "runs with SCHED_FIFO"),
        refused => tracing::warn!(
            priority,
            "runs without SCHED_FIFO ({refused:?}): allow it with `ulimit -r` or CAP_SYS_NICE"
        ),
    }
}
