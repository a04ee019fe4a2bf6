//! Attributes each late cycle to the machine or to the executor: late cycles read from the status board are compared
//! with the stalls of a reference thread of higher priority on the same core, and with the steal time of the host.
//! Runs on three threads: the reference and the watcher (both SCHED_FIFO), and the analyst.

use std::collections::VecDeque;
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use rcc_core::message::CycleStatus;
use rcc_ipc::{Cell, Session};
use rcc_os::clock::monotonic_ns;
use rcc_protocol::control::STATUS;
use rcc_protocol::{Announcement, Role};
use rtrb::Consumer;

use crate::cell_fixture::CellFixture;
use crate::journal::Journal;
use crate::reference::{ReferenceThread, STALL_NS, Stall, promote};

/// Period of the reference thread: a quarter of the executor's, so that few stalls fall between two wake-ups.
const REFERENCE_NS: u64 = 250_000;
/// A wake-up of the reference thread later than this is listed beside an unexplained late cycle; one of less than
/// [`STALL_NS`] explains none.
const LISTED_NS_MIN: u64 = 25_000;
/// Interval at which the watcher reads the status board.
const WATCH_EVERY: Duration = Duration::from_micros(250);
/// Stall per late cycle from which the machine is the cause. A cycle computes for far less than half of its period, so
/// a machine that made it late stalled for the rest; the reference misses at most one of its own periods of that.
const STALLED_NS_MIN: u64 = 250_000;
/// How long stalls and samples of the steal time are kept.
const KEEP_NS: u64 = 5_000_000_000;
/// Delay until a late cycle is attributed: all data about it has arrived by then.
const JUDGE_AFTER_NS: u64 = 300_000_000;
const ANALYSE_EVERY: Duration = Duration::from_millis(20);
/// Number of entries that are kept one by one; further ones are only counted unless unexplained.
const KEPT_MAX: usize = 2000;

/// Cause of a late cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The reference thread was late too, within the same interval.
    Machine {
        /// Sum of the reference thread's stalls in the interval, ns.
        stalled_ns: u64,
    },
    /// The reference was not late, but the host took time from the core (steal time in `/proc/stat`).
    Steal {
        /// Steal time, ticks of 10 ms.
        ticks: u64,
    },
    /// Neither: the executor is at fault.
    Unexplained,
}

/// One or more late cycles between two reads of the status board.
#[derive(Clone, Debug)]
pub struct LateCycles {
    /// Number of the last late cycle.
    pub cycle: u64,
    /// Number of late cycles.
    pub count: u64,
    /// Earliest time at which the last of them was due, CLOCK_MONOTONIC.
    pub from_ns: u64,
    /// Wake-up of the newest cycle when they were seen, CLOCK_MONOTONIC.
    pub to_ns: u64,
    /// Wake-up delay of the last late cycle, ns.
    pub wake_ns: u64,
    /// Computation time of the last late cycle, ns.
    pub exec_ns: u64,
    /// The cause.
    pub cause: Cause,
    /// Journal entries and stalls around that time; only if the cause is unexplained.
    pub beside: Vec<String>,
}

/// Late cycles of a run with their causes.
#[derive(Clone, Debug, Default)]
pub struct LatenessReport {
    /// Number of cycles watched.
    pub cycles: u64,
    /// Number of late cycles, as the executor counts them.
    pub late: u64,
    /// Late cycles during which the reference thread was late too.
    pub by_machine: u64,
    /// Late cycles explained only by the host's steal time.
    pub by_steal: u64,
    /// Late cycles without explanation, attributed to the executor.
    pub unexplained: u64,
    /// The entries one by one, at most 2000 plus all unexplained ones.
    pub each: Vec<LateCycles>,
    /// Number of wake-ups of the reference thread that were more than 0.1 ms late.
    pub stalls: u64,
    /// Longest stall of the reference thread, ns.
    pub stall_max_ns: u64,
    /// Longest computation time of a cycle, ns.
    pub exec_max_ns: u64,
    /// Number of monitor records that the executor dropped.
    pub dropped_records: u64,
    /// True if the cycle number never decreased and the incarnation of the executor never changed.
    pub consecutive: bool,
}

impl LatenessReport {
    /// Adds the report on another executor of the same run.
    pub fn add(&mut self, other: LatenessReport) {
        self.consecutive = other.consecutive && (self.consecutive || self.cycles == 0);
        self.cycles += other.cycles;
        self.late += other.late;
        self.by_machine += other.by_machine;
        self.by_steal += other.by_steal;
        self.unexplained += other.unexplained;
        self.each.extend(other.each);
        self.stalls += other.stalls;
        self.stall_max_ns = self.stall_max_ns.max(other.stall_max_ns);
        self.exec_max_ns = self.exec_max_ns.max(other.exec_max_ns);
        self.dropped_records += other.dropped_records;
    }
}

/// A running observation of an executor.
#[derive(Debug)]
pub struct LatenessMonitor {
    stop: Arc<AtomicBool>,
    watcher: JoinHandle<ObservedRange>,
    analyst: JoinHandle<LatenessReport>,
    reference: ReferenceThread,
    late: Arc<AtomicU64>,
}

/// First and last status read by the watcher.
struct ObservedRange {
    first: CycleStatus,
    last: CycleStatus,
    consecutive: bool,
}

impl LatenessMonitor {
    /// Starts watching the running executor, which has `priority` on `core`. `None` if the system does not grant
    /// real-time priorities: a late cycle cannot be attributed without them.
    pub fn start(
        place: &CellFixture,
        core: usize,
        priority: u8,
        journal: &Arc<Journal>,
    ) -> Option<LatenessMonitor> {
        let priority = i32::from(priority);
        let (reference, stalls) =
            ReferenceThread::stream(core, priority + 1, REFERENCE_NS, LISTED_NS_MIN)?;
        let stop = Arc::new(AtomicBool::new(false));
        let executor = place.announced(Role::Executor, "exec");
        let (late_in, late_out) = mpsc::channel();
        let (told, tell) = mpsc::channel();
        let (cell, stopped) = (place.cell().clone(), Arc::clone(&stop));
        let watcher = std::thread::spawn(move || {
            let other = (0..2).find(|&other| other != core);
            // Without the priority the watcher reads less often, and its intervals are longer.
            promote(other, priority - 1);
            watch(&cell, &executor, &stopped, &late_in, &told)
        });
        tell.recv().expect("the watcher begins");
        let count = Arc::new(AtomicU64::new(0));
        let analyst = LatenessAnalyst {
            core,
            late: late_out,
            stalls,
            journal: Arc::clone(journal),
            count: Arc::clone(&count),
            memory: RecentEvents::default(),
            report: LatenessReport::default(),
        };
        let stopped = Arc::clone(&stop);
        let analyst = std::thread::spawn(move || analyst.run(&stopped));
        Some(LatenessMonitor {
            stop,
            watcher,
            analyst,
            reference,
            late: count,
        })
    }

    /// Returns the number of unexplained late cycles so far.
    pub fn unexplained(&self) -> u64 {
        // Relaxed: a figure for the progress line.
        self.late.load(Ordering::Relaxed)
    }

    /// Stops watching and returns the report.
    pub fn finish(self) -> LatenessReport {
        // A late cycle at the very end shows in the status of the next cycles.
        std::thread::sleep(Duration::from_millis(50));
        self.stop.store(true, Ordering::Release);
        let watched = self.watcher.join().expect("the watcher does not panic");
        let mut report = self.analyst.join().expect("the analyst does not panic");
        self.reference.finish();
        report.cycles = watched.last.cycle - watched.first.cycle;
        report.late = watched.last.late - watched.first.late;
        report.exec_max_ns = watched.last.exec_max_ns;
        report.dropped_records = watched.last.dropped_records - watched.first.dropped_records;
        report.consecutive = watched.consecutive;
        let told = report.by_machine + report.by_steal + report.unexplained;
        report.unexplained += report.late.saturating_sub(told);
        report
    }
}

/// Reads the status board until stopped. Allocates only when a cycle was late.
fn watch(
    cell: &Cell,
    executor: &Announcement,
    stop: &AtomicBool,
    late: &mpsc::Sender<LateCycles>,
    told: &mpsc::Sender<()>,
) -> ObservedRange {
    let session = Session::join(cell, Role::Monitor, "lateness").expect("a cell");
    let board = session.open_board::<CycleStatus>(&executor.services[STATUS]);
    let board = board.expect("the status board");
    let first = board.read();
    let mut looks = [first, first];
    let mut consecutive = true;
    told.send(()).expect("the test waits");
    loop {
        let last = stop.load(Ordering::Acquire);
        let [before, newest] = looks;
        let now = board.read();
        if now.cycle > newest.cycle {
            if now.late > newest.late {
                let told = LateCycles {
                    cycle: now.last_late.cycle,
                    count: now.late - newest.late,
                    // The stall of a late cycle lies before its wake-up.
                    from_ns: before.stamp_ns.saturating_sub(now.last_late.wake_ns),
                    to_ns: now.stamp_ns,
                    wake_ns: now.last_late.wake_ns,
                    exec_ns: now.last_late.exec_ns,
                    cause: Cause::Unexplained,
                    beside: Vec::new(),
                };
                // The analyst keeps the receiver until after the last read; a failed send needs no handling.
                let _ = late.send(told);
            }
            looks = [newest, now];
        }
        consecutive &= now.cycle >= newest.cycle && now.incarnation == first.incarnation;
        if last {
            return ObservedRange {
                first,
                last: now,
                consecutive,
            };
        }
        std::thread::sleep(WATCH_EVERY);
    }
}

/// Stalls, steal time and late cycles of the last seconds.
#[derive(Default)]
struct RecentEvents {
    stalls: VecDeque<Stall>,
    /// Time (CLOCK_MONOTONIC, ns) and steal ticks of the core since boot.
    steal: VecDeque<(u64, u64)>,
    late: VecDeque<LateCycles>,
}

struct LatenessAnalyst {
    core: usize,
    late: mpsc::Receiver<LateCycles>,
    stalls: Consumer<Stall>,
    journal: Arc<Journal>,
    count: Arc<AtomicU64>,
    memory: RecentEvents,
    report: LatenessReport,
}

impl LatenessAnalyst {
    fn run(mut self, stop: &AtomicBool) -> LatenessReport {
        loop {
            let last = stop.load(Ordering::Acquire);
            if last {
                // Time for the watcher's last read and the stalls before it to arrive.
                std::thread::sleep(Duration::from_millis(10));
            }
            self.gather();
            let judged_ns = if last {
                u64::MAX
            } else {
                monotonic_ns() - JUDGE_AFTER_NS
            };
            while self
                .memory
                .late
                .front()
                .is_some_and(|late| late.to_ns < judged_ns)
            {
                let late = self.memory.late.pop_front().expect("just seen");
                self.judge(late);
            }
            if last {
                return self.report;
            }
            std::thread::sleep(ANALYSE_EVERY);
        }
    }

    fn gather(&mut self) {
        let now_ns = monotonic_ns();
        let old_ns = now_ns.saturating_sub(KEEP_NS);
        while let Ok(stall) = self.stalls.pop() {
            self.report.stalls += u64::from(stall.length_ns() > STALL_NS);
            self.report.stall_max_ns = self.report.stall_max_ns.max(stall.length_ns());
            self.memory.stalls.push_back(stall);
        }
        self.memory
            .steal
            .push_back((now_ns, steal_ticks(self.core)));
        self.memory.late.extend(self.late.try_iter());
        let RecentEvents { stalls, steal, .. } = &mut self.memory;
        while stalls.front().is_some_and(|stall| stall.to_ns < old_ns) {
            stalls.pop_front();
        }
        while steal.front().is_some_and(|(at_ns, _)| *at_ns < old_ns) {
            steal.pop_front();
        }
    }

    fn judge(&mut self, mut late: LateCycles) {
        late.cause = self.cause(&late);
        match late.cause {
            Cause::Machine { .. } => self.report.by_machine += late.count,
            Cause::Steal { .. } => self.report.by_steal += late.count,
            Cause::Unexplained => {
                self.report.unexplained += late.count;
                let around_ns = 50_000_000;
                let (from_ns, to_ns) = (late.from_ns - around_ns, late.to_ns + around_ns);
                late.beside = self.journal.between(from_ns, to_ns);
                let stalls = self.memory.stalls.iter();
                let near = stalls.filter(|stall| stall.from_ns < to_ns && stall.to_ns > from_ns);
                late.beside.extend(near.map(|stall| {
                    let (late_ns, after_ns) = (
                        stall.length_ns(),
                        stall.from_ns as i64 - late.from_ns as i64,
                    );
                    format!("reference late by {late_ns} ns, {after_ns} ns after the stretch began")
                }));
                eprintln!("UNEXPLAINED {late:?}");
            }
        }
        self.count.store(self.report.unexplained, Ordering::Relaxed);
        if self.report.each.len() < KEPT_MAX || late.cause == Cause::Unexplained {
            self.report.each.push(late);
        }
    }

    fn cause(&self, late: &LateCycles) -> Cause {
        let overlap_ns = |stall: &Stall| {
            let (from_ns, to_ns) = (stall.from_ns.max(late.from_ns), stall.to_ns.min(late.to_ns));
            to_ns.saturating_sub(from_ns)
        };
        let stalls = self.memory.stalls.iter();
        let counted = stalls.filter(|stall| stall.length_ns() > STALL_NS);
        let stalled_ns = counted.map(overlap_ns).sum();
        if stalled_ns >= late.count * STALLED_NS_MIN {
            return Cause::Machine { stalled_ns };
        }
        let ticks = |pick: Option<&(u64, u64)>| pick.map_or(0, |(_, ticks)| *ticks);
        let steal = &self.memory.steal;
        let before = ticks(steal.iter().rev().find(|(at_ns, _)| *at_ns < late.from_ns));
        let after = ticks(steal.iter().find(|(at_ns, _)| *at_ns > late.to_ns));
        match after.saturating_sub(before) {
            0 => Cause::Unexplained,
            _ if before == 0 => Cause::Unexplained,
            ticks => Cause::Steal { ticks },
        }
    }
}

/// Returns the steal time of a core since boot, ticks of 10 ms; 0 if it cannot be read.
pub fn steal_ticks(core: usize) -> u64 {
    let text = fs::read_to_string("/proc/stat").unwrap_or_default();
    let name = format!("cpu{core} ");
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix(name.as_str()));
    let field = line.and_then(|rest| rest.split_whitespace().nth(7));
    field.and_then(|word| word.parse().ok()).unwrap_or(0)
}
