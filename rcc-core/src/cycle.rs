//! One cycle of one net: the whole interpreter. The same function runs on the real-time thread, in tests (in virtual
//! time, where a cycle is a step) and in the benchmarks.

use crate::frame::Frame;
use crate::plan::{Delay, KernelRun, Plan};
use crate::primitives;
use crate::types::Store;

/// Evaluates every primitive once, in plan order, then copies the delayed links.
///
/// Accesses only `frame`, no clock and no randomness, so the same plan and inputs give the same bits.
pub fn cycle(plan: &Plan<'_>, frame: &mut Frame<'_>) {
    if plan.blocks.is_empty() {
        run_all(plan, frame, plan.runs);
    } else {
        run_blocks(plan, frame, |frame, _, runs| run_all(plan, frame, runs));
    }
    copy_delayed_links(plan, frame);
}

/// As [`cycle`], and returns how long the run `timed` took: the difference of two readings of `clock`, ns. The values
/// are the same. Returns 0 if there is no such run, or if its region is not active.
pub fn cycle_timed(
    plan: &Plan<'_>,
    frame: &mut Frame<'_>,
    timed: usize,
    clock: fn() -> u64,
) -> u64 {
    let mut ns = 0;
    if plan.blocks.is_empty() {
        ns = run_timed(plan, frame, plan.runs, timed, clock);
    } else {
        run_blocks(plan, frame, |frame, first, runs| {
            match timed.checked_sub(first).filter(|at| *at < runs.len()) {
                Some(timed) => ns = run_timed(plan, frame, runs, timed, clock),
                None => run_all(plan, frame, runs),
            }
        });
    }
    copy_delayed_links(plan, frame);
    ns
}

fn run_all(plan: &Plan<'_>, frame: &mut Frame<'_>, runs: &[KernelRun]) {
    for run in runs {
        if let Some(operands) = plan.operands_of(run) {
            primitives::run(run.kernel, frame, operands);
        }
    }
}

fn run_timed(
    plan: &Plan<'_>,
    frame: &mut Frame<'_>,
    runs: &[KernelRun],
    timed: usize,
    clock: fn() -> u64,
) -> u64 {
    let (before, rest) = runs.split_at(timed.min(runs.len()));
    run_all(plan, frame, before);
    let mut ns = 0;
    if let Some((timed, after)) = rest.split_first() {
        let begun_ns = clock();
        run_all(plan, frame, core::slice::from_ref(timed));
        ns = clock().saturating_sub(begun_ns);
        run_all(plan, frame, after);
    }
    ns
}

/// Decides each region at its first block, and passes the blocks that are evaluated to `run`, with the index of their
/// first run.
fn run_blocks<'a>(
    plan: &Plan<'a>,
    frame: &mut Frame<'_>,
    mut run: impl FnMut(&mut Frame<'_>, usize, &'a [KernelRun]),
) {
    let (mut runs, mut blanks) = (plan.runs, plan.blanks);
    let (mut first, mut decided) = (0, 0);
    for block in plan.blocks {
        let (now, later) = runs.split_at((block.runs as usize).min(runs.len()));
        let region = plan.regions.get(block.region as usize);
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

fn copy_delayed_links(plan: &Plan<'_>, frame: &mut Frame<'_>) {
    for delay in plan.delays {
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
