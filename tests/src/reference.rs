//! A reference thread that wakes more often than the executor, at a higher priority, on the same core. When it is late
//! too, the machine caused the delay, not the executor.
#![allow(unsafe_code)] // `sched_setscheduler` has no safe wrapper in nix.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use nix::sched::{CpuSet, sched_setaffinity};
use nix::unistd::Pid;
use rcc_os::clock::{monotonic_ns, sleep_until};

/// An eighth of the executor's period: with one whole period, a stall of half a period could fall between two wake-ups.
const PERIOD_NS: u64 = 125_000;
/// A wake-up later than this counts as a stall: a tenth of the executor's period.
pub const STALL_NS: u64 = 100_000;
/// Capacity of the ring of [`ReferenceThread::stream`], in stalls.
const RING: usize = 16_384;

/// An interval in which the reference thread was ready but did not run, CLOCK_MONOTONIC.
#[derive(Clone, Copy, Debug)]
pub struct Stall {
    /// Time at which it should have woken.
    pub from_ns: u64,
    /// Time at which it woke.
    pub to_ns: u64,
}

impl Stall {
    /// Returns its length, ns.
    pub fn length_ns(&self) -> u64 {
        self.to_ns - self.from_ns
    }
}

/// A running reference thread.
#[derive(Debug)]
pub struct ReferenceThread {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Vec<Stall>>,
}

impl ReferenceThread {
    /// Starts the thread on `core`; `None` if the system does not grant the priority.
    pub fn start(core: usize, priority: i32) -> Option<ReferenceThread> {
        let stop = Arc::new(AtomicBool::new(false));
        let (told, tell) = std::sync::mpsc::channel();
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let granted = promote(Some(core), priority);
            told.send(granted).expect("the test waits");
            let mut stalls = Vec::with_capacity(100_000);
            if granted {
                watch(&stopped, PERIOD_NS, STALL_NS, |stall| stalls.push(stall));
            }
            stalls
        });
        tell.recv()
            .expect("the thread reports its priority")
            .then_some(ReferenceThread { stop, thread })
    }

    /// Like [`ReferenceThread::start`], but wakes every `period_ns` and passes each wake-up on at once that is later than
    /// `late_ns`. The thread does not allocate, so that it causes no stall itself. A full ring drops stalls, which then
    /// explain no late cycle.
    pub fn stream(
        core: usize,
        priority: i32,
        period_ns: u64,
        late_ns: u64,
    ) -> Option<(ReferenceThread, rtrb::Consumer<Stall>)> {
        let (mut stalls, handed) = rtrb::RingBuffer::new(RING);
        let stop = Arc::new(AtomicBool::new(false));
        let (told, tell) = std::sync::mpsc::channel();
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            touch(&mut stalls);
            let granted = promote(Some(core), priority);
            told.send(granted).expect("the test waits");
            if granted {
                watch(&stopped, period_ns, late_ns, |stall| {
                    // A full ring drops the stall, see above.
                    let _ = stalls.push(stall);
                });
            }
            Vec::new()
        });
        let mut handed = handed;
        let granted = tell.recv().expect("the thread reports its priority");
        while handed.pop().is_ok_and(|stall| stall.to_ns == 0) {}
        granted.then_some((ReferenceThread { stop, thread }, handed))
    }

    /// Stops the thread and returns all stalls; none if it was started by [`ReferenceThread::stream`].
    pub fn finish(self) -> Vec<Stall> {
        self.stop.store(true, Ordering::Release);
        self.thread
            .join()
            .expect("the reference thread does not panic")
    }
}

/// Pins the calling thread to `core`, if given, and makes it SCHED_FIFO; false if the system refuses either.
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

/// Writes every slot of the ring once, so that its pages do not fault later.
fn touch(stalls: &mut rtrb::Producer<Stall>) {
    let empty = Stall {
        from_ns: 0,
        to_ns: 0,
    };
    // Ends when the ring is full.
    while stalls.push(empty).is_ok() {}
}

fn watch(stop: &AtomicBool, period_ns: u64, late_ns: u64, mut tell: impl FnMut(Stall)) {
    let mut deadline_ns = monotonic_ns() + period_ns;
    while !stop.load(Ordering::Acquire) {
        sleep_until(deadline_ns);
        let now_ns = monotonic_ns();
        if now_ns - deadline_ns > late_ns {
            tell(Stall {
                from_ns: deadline_ns,
                to_ns: now_ns,
            });
        }
        deadline_ns = (deadline_ns + period_ns).max(now_ns + period_ns / 2);
    }
}
