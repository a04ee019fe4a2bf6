//! One cycle of one net: the whole interpreter. The same function runs on the real-time thread, in tests (in virtual
//! time, where a cycle is a step) and in the benchmarks.

use core::fmt;

use crate::frame::Frame;
use crate::plan::{Delay, KernelRun, NullRange, PlanRegion, RunBlock};
use crate::primitives::{self, RunKernel};
use crate::types::Store;

/// A run whose kernel was looked up, before the first cycle.
#[derive(Clone, Copy)]
pub struct ReadyRun {
    kernel: RunKernel,
    first: u32,
    operands: u32,
}

impl fmt::Debug for ReadyRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, operands) = (self.first, self.operands);
        write!(f, "ReadyRun({operands} operands from {first})")
    }
}

impl ReadyRun {
    /// Looks up the kernel of a run.
    #[must_use]
    pub fn of(run: &KernelRun) -> ReadyRun {
        ReadyRun {
            kernel: primitives::function(run.kernel),
            first: run.first,
            operands: run.operands,
        }
    }

    #[inline(always)]
    fn run(&self, operands: &[u32], frame: &mut Frame<'_>) {
        let operands = operands.get(self.first as usize..);
        let operands = operands.and_then(|rest| rest.get(..self.operands as usize));
        if let Some(operands) = operands {
            (self.kernel)(frame, operands);
        }
    }
}

/// The steps of a cycle in their order: the part of a plan that it reads.
#[derive(Clone, Copy, Debug)]
pub struct Schedule<'a> {
    /// The runs of the plan.
    pub runs: &'a [ReadyRun],
    /// As in the plan.
    pub operands: &'a [u32],
    /// As in the plan.
    pub blocks: &'a [RunBlock],
    /// As in the plan.
    pub regions: &'a [PlanRegion],
    /// As in the plan.
    pub blanks: &'a [NullRange],
    /// As in the plan.
    pub delays: &'a [Delay],
}

/// Evaluates every primitive once, in plan order, then copies the delayed links.
///
/// Accesses only `frame`, no clock and no randomness, so the same plan and inputs give the same bits.
#[inline]
pub fn cycle(schedule: &Schedule<'_>, frame: &mut Frame<'_>) {
    if schedule.blocks.is_empty() {
        run_all(schedule, frame, schedule.runs);
    } else {
        run_blocks(schedule, frame, |frame, _, runs| {
            run_all(schedule, frame, runs);
        });
    }
    copy_delayed_links(schedule, frame);
}

/// As [`cycle`], and returns how long the run `timed` took: the difference of two readings of `clock`, ns. The values
/// are the same. Returns 0 if there is no such run, or if its region is not active.
pub fn cycle_timed(
    schedule: &Schedule<'_>,
    frame: &mut Frame<'_>,
    timed: usize,
    clock: fn() -> u64,
) -> u64 {
    let mut ns = 0;
    if schedule.blocks.is_empty() {
        ns = run_timed(schedule, frame, schedule.runs, timed, clock);
    } else {
        run_blocks(schedule, frame, |frame, first, runs| {
            match timed.checked_sub(first).filter(|at| *at < runs.len()) {
                Some(timed) => ns = run_timed(schedule, frame, runs, timed, clock),
                None => run_all(schedule, frame, runs),
            }
        });
    }
    copy_delayed_links(schedule, frame);
    ns
}

fn run_all(schedule: &Schedule<'_>, frame: &mut Frame<'_>, runs: &[ReadyRun]) {
    for run in runs {
        run.run(schedule.operands, frame);
    }
}

fn run_timed(
    schedule: &Schedule<'_>,
    frame: &mut Frame<'_>,
    runs: &[ReadyRun],
    timed: usize,
    clock: fn() -> u64,
) -> u64 {
    let (before, rest) = runs.split_at(timed.min(runs.len()));
    run_all(schedule, frame, before);
    let mut ns = 0;
    if let Some((timed, after)) = rest.split_first() {
        let begun_ns = clock();
        run_all(schedule, frame, core::slice::from_ref(timed));
        ns = clock().saturating_sub(begun_ns);
        run_all(schedule, frame, after);
    }
    ns
}

/// Decides each region at its first block, and passes the blocks that are evaluated to `run`, with the index of their
/// first run.
fn run_blocks<'a>(
    schedule: &Schedule<'a>,
    frame: &mut Frame<'_>,
    mut run: impl FnMut(&mut Frame<'_>, usize, &'a [ReadyRun]),
) {
    let (mut runs, mut blanks) = (schedule.runs, schedule.blanks);
    let (mut first, mut decided) = (0, 0);
    for block in schedule.blocks {
        let (now, later) = runs.split_at((block.runs as usize).min(runs.len()));
        let region = schedule.regions.get(block.region as usize);
        if let Some(region) = region.filter(|_| block.region == decided) {
            let (mine, others) = blanks.split_at((region.blanks as usize).min(blanks.len()));
            region.decide(mine, frame);
            blanks = others;
            decided += 1;
        }
        if region.is_none_or(|region| region.is_active(frame)) {
            run(frame, first, now);
        }
        first += now.len();
        runs = later;
    }
}

#[inline]
fn copy_delayed_links(schedule: &Schedule<'_>, frame: &mut Frame<'_>) {
    for delay in schedule.delays {
        copy_delayed_link(frame, delay);
    }
    frame.cycle += 1;
}

fn copy_delayed_link(frame: &mut Frame<'_>, delay: &Delay) {
    let (from, to, width) = (delay.from as usize, delay.to as usize, delay.width as usize);
    match delay.store {
        Store::Real => copy_within(frame.reals, from, to, width),
        Store::Bool => copy_within(frame.bools, from, to, width),
        Store::Int => copy_within(frame.ints, from, to, width),
    }
}

fn copy_within<T: Copy>(arena: &mut [T], from: usize, to: usize, width: usize) {
    // Most links carry one value; a call to copy it would cost more than the primitive that reads it.
    if width == 1 {
        if let Some(value) = arena.get(from).copied()
            && let Some(place) = arena.get_mut(to)
        {
            *place = value;
        }
        return;
    }
    // `copy_within` panics outside the slice; `Plan::check` excludes that, and this check guarantees it locally.
    if from + width <= arena.len() && to + width <= arena.len() {
        arena.copy_within(from..from + width, to);
    }
}
