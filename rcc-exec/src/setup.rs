//! Real-time privileges that the executor requests at start: locked memory, SCHED_FIFO and a processor core. Collects
//! the reasons for refusals; the executor also works without any of them. Runs before the first cycle.

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

/// Bit in `CycleStatus::grants`: the thread runs under SCHED_FIFO.
pub const FIFO: u32 = 1;
/// Bit in `CycleStatus::grants`: memory is locked.
pub const LOCKED: u32 = 2;
/// Bit in `CycleStatus::grants`: the thread is pinned to the configured core.
pub const PINNED: u32 = 4;

/// The granted privileges, and the reasons for refusals.
#[derive(Clone, Debug, Default)]
pub struct Grants {
    /// [`FIFO`] | [`LOCKED`] | [`PINNED`].
    pub bits: u32,
    /// One sentence per refusal, with the remedy.
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

/// Locks all memory, current and future. It does not try under a finite limit, because later mappings would then fail
/// in the middle of operation.
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

/// Puts the calling thread under SCHED_FIFO with `priority` (1 to 99), and pins it to `core` if one is given.
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

/// Touches the stack that the cycle may use, so that the cycle causes no page fault.
pub fn prefault_stack() {
    let pages = std::hint::black_box([0_u8; 256 << 10]);
    std::hint::black_box(&pages);
}
