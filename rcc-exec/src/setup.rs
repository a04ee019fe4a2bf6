//! What the executor asks of the system: locked memory, SCHED_FIFO, a core. Says what it did not get;
//! everything also works without. Run at start, before the first cycle.

use std::fmt;

use nix::errno::Errno;
use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use nix::unistd::{Pid, geteuid};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Bit in `CycleStatus::grants`: SCHED_FIFO.
pub const FIFO: u32 = 1;
/// Bit in `CycleStatus::grants`: memory locked.
pub const LOCKED: u32 = 2;
/// Bit in `CycleStatus::grants`: pinned to the configured core.
pub const PINNED: u32 = 4;

/// What was obtained, and why not.
#[derive(Clone, Debug, Default)]
pub struct Grants {
    /// [`FIFO`] | [`LOCKED`] | [`PINNED`].
    pub bits: u32,
    /// A sentence for each thing that was refused.
    pub refusals: Vec<String>,
}

impl fmt::Display for Grants {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.refusals.is_empty() {
            return write!(f, "RT: granted");
        }
        write!(f, "RT: degraded, because {}", self.refusals.join("; "))
    }
}

/// Locks all memory, now and future. Under a finite limit it does not try: future mappings would fail where they hurt.
pub fn lock_memory(grants: &mut Grants) {
    let limit = getrlimit(Resource::RLIMIT_MEMLOCK).map_or(0, |(soft, _)| soft);
    if limit != RLIM_INFINITY && !geteuid().is_root() {
        grants.refusals.push(format!(
            "memory is not locked (the limit `memlock` is {} kB): raise it (LimitMEMLOCK=infinity)",
            limit >> 10
        ));
        return;
    }
    match mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE) {
        Ok(()) => grants.bits |= LOCKED,
        Err(error) => grants.refusals.push(format!(
            "memory is not locked ({}): raise the limit `memlock` (LimitMEMLOCK=infinity)",
            error.desc()
        )),
    }
}

/// Makes the calling thread SCHED_FIFO, and pins it if a core is configured.
pub fn promote_thread(priority: u8, core: Option<usize>, grants: &mut Grants) {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority).map(ThreadPriority::Crossplatform);
    match value.map(|value| set_thread_priority_and_policy(thread_native_id(), value, policy)) {
        Ok(Ok(())) => grants.bits |= FIFO,
        Ok(Err(error)) => grants.refusals.push(format!(
            "SCHED_FIFO {priority} was refused ({}): raise the limit `rtprio` (LimitRTPRIO={priority})",
            cause(&error)
        )),
        Err(_) => grants.refusals.push(format!("SCHED_FIFO has no priority {priority}: choose 1 to 99")),
    }
    let Some(core) = core else { return };
    let mut set = CpuSet::new();
    match set
        .set(core)
        .and_then(|()| sched_setaffinity(Pid::from_raw(0), &set))
    {
        Ok(()) => grants.bits |= PINNED,
        Err(error) => grants
            .refusals
            .push(format!("core {core} was refused ({})", error.desc())),
    }
}

fn cause(error: &thread_priority::Error) -> String {
    match error {
        thread_priority::Error::OS(number) => Errno::from_raw(*number).desc().to_owned(),
        other => format!("{other:?}"),
    }
}

/// Touches the stack that the cycle may use, so that no page fault happens in it.
pub fn prefault_stack() {
    let pages = std::hint::black_box([0_u8; 256 << 10]);
    std::hint::black_box(&pages);
}
