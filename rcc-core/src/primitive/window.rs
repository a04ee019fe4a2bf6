//! Sliding windows over the last values, stored as a binary tree: the leaves are a ring of values, each inner node
//! combines its two children, and the root is the result. A new value updates only the nodes above it, one for each
//! doubling of the window length, so each cycle costs the same and no running sum drifts. Tangwongsan, Hirzel,
//! Schneider, Wu: "General incremental sliding-window aggregation", PVLDB 8 (2015), section 4 (FlatFAT). Run by the
//! real-time thread.

use super::{
    Int, Parameter, ParameterKind, Port, Real, Slot, Spec, StateSpec, UnitRule, each, operands,
};
use crate::frame::Frame;

/// The part of the spec that all windows of numbers share: null rule and types. A primitive adds its name, texts,
/// examples, and its memory with the identity of its `combine`.
pub const WINDOW: Spec = Spec {
    null: "null while the window contains a null value, element by element; until the window is full, the result covers the values so far",
    inputs: &[Port::linear(
        "in",
        UnitRule::Var(0),
        "a number, vector, array or matrix",
    )],
    outputs: &[Port::linear(
        "out",
        UnitRule::Var(0),
        "the result, of each element",
    )],
    parameters: &[Parameter::new(
        "window",
        ParameterKind::Window,
        "length of the window, including the current value; 1 to 10 000 cycles of the net",
    )
    .above(0.0)],
    // index of the next value, number of values so far
    state: StateSpec {
        ints: 2,
        ..StateSpec::NONE
    },
    ..Spec::PLAIN
};

/// The aggregation that a window computes.
pub trait Fold {
    /// Maps a value before it is combined with others; NaN must stay NaN.
    fn leaf(value: f64) -> f64;
    /// Combines two nodes; must return NaN if either is NaN.
    fn combine(a: f64, b: f64) -> f64;
    /// Computes the result from the root and the number of values.
    fn result(root: f64, count: f64) -> f64;
}

operands! {
    /// The first of the two Ints is the index of the next value, the second the number of values so far, at most
    /// `cycles`; one tree of `2 · cycles` nodes for each element.
    struct Window {
        input: Slot<Real>, out: Slot<Real>, ints: Slot<Int>, tree: Slot<Real>, width: u32, cycles: u32,
    }
}

/// Runs the step of a window.
#[inline(always)]
pub fn each_window<F: Fold>(frame: &mut Frame<'_>, operands: &[u32]) {
    each(frame, operands, step::<F>);
}

fn step<F: Fold>(frame: &mut Frame<'_>, window: Window) -> Option<()> {
    let Window { ints, cycles, .. } = window;
    let place = u32::try_from(frame.get(ints)?).ok()?;
    let place = place.min(cycles.saturating_sub(1));
    let count = frame
        .get(ints + 1)?
        .saturating_add(1)
        .min(i64::from(cycles));
    for i in 0..window.width {
        let tree = window.tree + i * 2 * cycles;
        let value = frame.get(window.input + i)?;
        let mut node = cycles + place;
        frame.put(tree + node, F::leaf(value))?;
        // At most one step for each bit of the window's length.
        for _ in 0..u32::BITS {
            if node < 2 {
                break;
            }
            node /= 2;
            let (a, b) = (
                frame.get(tree + 2 * node)?,
                frame.get(tree + (2 * node + 1))?,
            );
            frame.put(tree + node, F::combine(a, b))?;
        }
        let root = frame.get(tree + 1)?;
        frame.put(window.out + i, F::result(root, count as f64))?;
    }
    frame.put(ints + 1, count)?;
    let next = if place + 1 < cycles { place + 1 } else { 0 };
    frame.put(ints, i64::from(next))
}
