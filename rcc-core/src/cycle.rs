//! One cycle of one net: the whole interpreter. The same function runs on the real-time thread, in
//! tests (virtual time: a cycle is a step) and in the benchmarks.

use crate::frame::Frame;
use crate::plan::{Delay, Plan, Run};
use crate::primitives;
use crate::types::Store;

/// Evaluates every primitive once, in plan order, then moves the delayed links on.
///
/// Touches only `frame`; no clock, no chance, so the same plan and inputs give the same bits.
pub fn cycle(plan: &Plan<'_>, frame: &mut Frame<'_>) {
    run_all(plan, frame, plan.runs);
    move_on(plan, frame);
}

/// As [`cycle`], and says how long the run `timed` took: the time between two looks at `clock`, ns. The values are the
/// same. 0 if there is no such run.
pub fn cycle_timed(
    plan: &Plan<'_>,
    frame: &mut Frame<'_>,
    timed: usize,
    clock: fn() -> u64,
) -> u64 {
    let (before, rest) = plan.runs.split_at(timed.min(plan.runs.len()));
    run_all(plan, frame, before);
    let mut ns = 0;
    if let Some((timed, after)) = rest.split_first() {
        let begun_ns = clock();
        run_all(plan, frame, core::slice::from_ref(timed));
        ns = clock().saturating_sub(begun_ns);
        run_all(plan, frame, after);
    }
    move_on(plan, frame);
    ns
}

fn run_all(plan: &Plan<'_>, frame: &mut Frame<'_>, runs: &[Run]) {
    for run in runs {
        if let Some(operands) = plan.operands_of(run) {
            primitives::run(run.kernel, frame, operands);
        }
    }
}

fn move_on(plan: &Plan<'_>, frame: &mut Frame<'_>) {
    for delay in plan.delays {
        carry_over(frame, delay);
    }
    frame.cycle += 1;
}

fn carry_over(frame: &mut Frame<'_>, delay: &Delay) {
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
    // `copy_within` panics outside the slice; `Plan::check` excludes it and this makes it certain.
    if from + width <= arena.len() && to + width <= arena.len() {
        arena.copy_within(from..from + width, to);
    }
}
