//! Timing: histograms, late cycles with their cause and the most expensive net, and the cost of primitives. Real-time
//! thread.
//!
//! The clock is read once before the nets, once after each of them, and twice for the one run of primitives that is timed
//! per cycle, without a system call. The time of a net contains all that a cycle does for it: evaluation, guard, monitors
//! and record.

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::histogram::Histogram;
use rcc_core::message::{CommandState, EndReason, FaultCode, MAGIC};
use rcc_core::primitives::{self, KERNELS_MAX};
use rcc_core::timing::{CycleTiming, LateCause, LateCycle, PrimitiveTime};
use rcc_os::clock::monotonic_ns;

use super::Engine;
use crate::boards::DeviceBoards;
use crate::net::{Evaluation, Net, RunTime};
use crate::queue::EngineEvent;
use crate::record::TriggerReason;
use crate::rows::RowIndex;

/// Period of writing the timing board, ns.
const TIMING_EVERY_NS: u64 = 100_000_000;
/// Number of clock reads for measuring the cost of one.
const CLOCK_READS: usize = 1000;

/// Timing data of the engine.
#[derive(Debug)]
pub(super) struct CycleTimer {
    timing: Box<CycleTiming>,
    clock: fn() -> u64,
    /// Cost of one clock read, ns.
    clock_read_ns: u64,
    woke_ns: u64,
    /// When the net that is evaluated began.
    begun_ns: Option<u64>,
    /// When the net before it ended; `None` if something else was done since.
    ended_ns: Option<u64>,
    /// Row of the command table whose net is timed next.
    next_row: RowIndex,
    sampled: bool,
    /// Id of the command with the longest evaluation in this cycle, and its duration, ns.
    most_expensive: (u64, u64),
    /// Consecutive cycles that were late because of computation; a punctual cycle resets the count, one that woke late does
    /// not.
    late_in_a_row: u32,
    every: u64,
    due: bool,
}

impl CycleTimer {
    pub(super) fn new(period_ns: u64) -> CycleTimer {
        let mut timing: Box<CycleTiming> = bytemuck::zeroed_box();
        timing.magic = MAGIC;
        timing.catalogue = primitives::fingerprint();
        CycleTimer {
            timing,
            clock: monotonic_ns,
            clock_read_ns: clock_read_cost(monotonic_ns),
            woke_ns: 0,
            begun_ns: None,
            ended_ns: None,
            next_row: RowIndex::FIRST,
            sampled: false,
            most_expensive: (0, 0),
            late_in_a_row: 0,
            every: TIMING_EVERY_NS.checked_div(period_ns).unwrap_or(1).max(1),
            due: false,
        }
    }

    /// A cycle begins; `now_ns` is when it woke.
    pub(super) fn begin(&mut self, now_ns: u64) {
        if self.woke_ns != 0 {
            self.timing.length.add(now_ns.saturating_sub(self.woke_ns));
        }
        self.woke_ns = now_ns;
        self.most_expensive = (0, 0);
        self.due = false;
    }

    /// Evaluates the net in `row`; times its run `next_run` if it is the row's turn.
    pub(super) fn evaluate(
        &mut self,
        row: RowIndex,
        (net, next_run): (&mut Net, &mut usize),
        (models, inputs): (&[DeviceModel], &[DeviceInput]),
        dt_s: f64,
    ) -> Evaluation {
        let begun_ns = self.ended_ns.unwrap_or_else(self.clock);
        self.begun_ns = Some(begun_ns);
        if row != self.next_row || self.sampled {
            return net.evaluate(models, inputs, dt_s);
        }
        let timed = (*next_run, self.clock);
        let (evaluation, time) = net.evaluate_timed(models, inputs, dt_s, timed);
        self.sampled = true;
        if let Some(time) = time {
            self.add_run_time(time);
        }
        *next_run += 1;
        if *next_run >= net.runs() {
            *next_run = 0;
            self.next_row = row.next();
        }
        evaluation
    }

    /// The net that was evaluated last is done: returns its time, ns. `None` if none was evaluated since.
    pub(super) fn end_net(&mut self) -> Option<u64> {
        let begun_ns = self.begun_ns.take()?;
        let now_ns = (self.clock)();
        self.ended_ns = Some(now_ns);
        Some(now_ns.saturating_sub(begun_ns))
    }

    /// Something else than a net follows.
    pub(super) fn end_nets(&mut self) {
        self.ended_ns = None;
    }

    fn add_run_time(&mut self, time: RunTime) {
        let place = usize::from(time.kernel) / KERNELS_MAX;
        if let Some(row) = self.timing.primitives.get_mut(place) {
            let ns = time.ns.saturating_sub(self.clock_read_ns);
            row.runs += 1;
            row.primitives += u64::from(time.primitives);
            row.sum_ns += ns;
            row.max_ns = row.max_ns.max(ns);
        }
    }

    /// Records the duration of a command's evaluation in this cycle.
    pub(super) fn record_duration(&mut self, id: u64, exec_ns: u64) {
        if exec_ns >= self.most_expensive.1 {
            self.most_expensive = (id, exec_ns);
        }
    }
}

impl<B: DeviceBoards> Engine<B> {
    /// Uses another clock (ns) for durations of nets; it must be suitable for the real-time thread.
    #[must_use]
    pub fn with_clock(mut self, clock: fn() -> u64) -> Engine<B> {
        self.time.clock = clock;
        self.time.clock_read_ns = 0;
        self
    }

    /// Histograms, and the cost of primitives.
    pub fn timing(&self) -> &CycleTiming {
        &self.time.timing
    }

    /// Returns true if the timing board should be written in this cycle.
    pub fn timing_due(&self) -> bool {
        self.time.due
    }

    /// After the nets: selects the active net that is timed next.
    pub(super) fn select_next_timed_net(&mut self) {
        let cycle = self.status.cycle;
        self.time.due |= cycle.is_multiple_of(self.time.every);
        if self.time.due {
            self.time.timing.cycle = cycle;
        }
        // A net that was not due waits for its turn in the next round: slow nets are timed less often.
        let sampled = std::mem::take(&mut self.time.sampled);
        let first = match sampled {
            true => self.time.next_row,
            false => self.time.next_row.next(),
        };
        // Every active row is in `busy`, so other rows need not be checked. Rows from `first` on, then the others.
        let busy = self.commands.busy;
        let mut turns = busy.starting_at(first).rows().chain(busy.rows());
        let next = turns.find(|row| self.commands[*row].is_active());
        self.time.next_row = next.unwrap_or(RowIndex::FIRST);
    }

    /// Accounts for a finished cycle: how late it woke, how long it took (ns), and how many periods it skipped; a cycle
    /// that skipped a period is late.
    pub fn account(&mut self, wake_ns: u64, exec_ns: u64, skipped_periods: u64) {
        let status = &mut self.status;
        status.exec_last_ns = exec_ns;
        status.exec_max_ns = status.exec_max_ns.max(exec_ns);
        status.worst_wake_ns = status.worst_wake_ns.max(wake_ns);
        self.time.timing.wake.add(wake_ns);
        self.time.timing.exec.add(exec_ns);
        if let Some(recorder) = &mut self.recorder {
            recorder.end(wake_ns, exec_ns, skipped_periods);
            status.incidents = recorder.handed_over();
        }
        if skipped_periods == 0 {
            self.time.late_in_a_row = 0;
            return;
        }
        let (command, command_ns) = self.time.most_expensive;
        let cause = LateCause::of(wake_ns, exec_ns);
        let late = LateCycle {
            cycle: status.cycle,
            wake_ns,
            exec_ns,
            skipped_periods,
            command,
            command_ns,
            cause: cause as u32,
            reserved: 0,
        };
        status.late += 1;
        match cause {
            LateCause::ComputedLong => status.late_computed += 1,
            _ => status.late_woken += 1,
        }
        status.skipped_periods += skipped_periods;
        status.last_late = late;
        if status.first_late.cycle == 0 {
            status.first_late = late;
        }
        self.log(EngineEvent::Late(late));
        // Waking late is not the fault of a net: such a cycle neither counts nor resets the count.
        if cause == LateCause::ComputedLong {
            self.time.late_in_a_row += 1;
            if self.time.late_in_a_row == self.late_in_a_row_max {
                self.time.late_in_a_row = 0;
                if let Some(recorder) = &mut self.recorder {
                    recorder.trigger(TriggerReason::Late);
                }
                self.end_most_expensive();
            }
        }
    }

    /// Acknowledges late cycles: resets latches, worst values and histograms.
    pub(super) fn acknowledge(&mut self) {
        let status = &mut self.status;
        let late = status.late - status.late_acknowledged;
        status.late_acknowledged = status.late;
        (status.first_late, status.last_late) = (LateCycle::NONE, LateCycle::NONE);
        (status.worst_wake_ns, status.exec_max_ns) = (0, 0);
        let cycle = status.cycle;
        let timing = &mut *self.time.timing;
        timing.wake_acknowledged.merge(&timing.wake);
        timing.exec_acknowledged.merge(&timing.exec);
        for histogram in [&mut timing.wake, &mut timing.exec, &mut timing.length] {
            *histogram = Histogram::zeroed();
        }
        timing.primitives.fill(PrimitiveTime::zeroed());
        timing.acknowledged_cycle = cycle;
        self.time.due = true;
        self.log(EngineEvent::Acknowledged { cycle, late });
    }

    /// Ends the net that took longest in this cycle: too many cycles were late because of computation. If it has ended by
    /// itself, no other one ends for it.
    fn end_most_expensive(&mut self) {
        let (id, _) = self.time.most_expensive;
        if let Ok(row) = self.commands.find(id, CommandState::is_active) {
            self.end(row, EndReason::Fault, self.fault(FaultCode::Overrun));
        }
    }
}

/// The shortest of many intervals between two consecutive clock reads, ns.
fn clock_read_cost(clock: fn() -> u64) -> u64 {
    let differences = (0..CLOCK_READS).map(|_| {
        let before_ns = clock();
        clock().saturating_sub(before_ns)
    });
    differences.min().unwrap_or(0)
}
