//! A reference thread: wakes every millisecond at a higher priority than the executor, on the same
//! core. Where it is late too, the machine was, and not the executor. It is a thread of its own.
#![allow(unsafe_code)] // A scheduler call that has no safe wrapper.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_nanosleep};
use nix::unistd::Pid;
use rcc_ipc::monotonic_ns;

const PERIOD_NS: u64 = 1_000_000;

/// A stretch in which the machine did not let the reference thread run, CLOCK_MONOTONIC.
#[derive(Clone, Copy, Debug)]
pub struct Stall {
    /// When it should have woken.
    pub from_ns: u64,
    /// When it did.
    pub to_ns: u64,
}

/// The running thread.
#[derive(Debug)]
pub struct Reference {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Vec<Stall>>,
}

impl Reference {
    /// Starts it on `core`; `None` if the system does not grant the priority.
    pub fn start(core: usize, priority: i32) -> Option<Reference> {
        let stop = Arc::new(AtomicBool::new(false));
        let (told, tell) = std::sync::mpsc::channel();
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let granted = promote(Some(core), priority);
            told.send(granted).expect("the test waits");
            if granted { watch(&stopped) } else { Vec::new() }
        });
        tell.recv()
            .expect("the thread tells")
            .then_some(Reference { stop, thread })
    }

    /// Ends it; returns every wake-up that was late by more than a tenth of a period.
    pub fn finish(self) -> Vec<Stall> {
        self.stop.store(true, Ordering::Release);
        self.thread
            .join()
            .expect("the reference thread does not panic")
    }
}

/// Makes the calling thread SCHED_FIFO, and pins it; false if the system refuses.
pub fn promote(core: Option<usize>, priority: i32) -> bool {
    let mut set = CpuSet::new();
    let pinned = core.is_none_or(|core| {
        set.set(core)
            .and_then(|()| sched_setaffinity(Pid::from_raw(0), &set))
            .is_ok()
    });
    let parameters = libc::sched_param {
        sched_priority: priority,
    };
    // SAFETY: `parameters` is a valid `sched_param` that outlives the call; pid 0 is the calling thread.
    pinned && unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) } == 0
}

fn watch(stop: &AtomicBool) -> Vec<Stall> {
    let mut stalls = Vec::with_capacity(100_000);
    let mut deadline_ns = monotonic_ns() + PERIOD_NS;
    while !stop.load(Ordering::Acquire) {
        let deadline = TimeSpec::from_duration(Duration::from_nanos(deadline_ns));
        while clock_nanosleep(
            ClockId::CLOCK_MONOTONIC,
            ClockNanosleepFlags::TIMER_ABSTIME,
            &deadline,
        )
        .is_err()
        {}
        let now_ns = monotonic_ns();
        if now_ns - deadline_ns > PERIOD_NS / 10 {
            stalls.push(Stall {
                from_ns: deadline_ns,
                to_ns: now_ns,
            });
        }
        deadline_ns = (deadline_ns + PERIOD_NS).max(now_ns + PERIOD_NS / 2);
    }
    stalls
}
