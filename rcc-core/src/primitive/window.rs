//! Windows over the last values, as a tree: the leaves are a ring of values, each node combines two others, the root is
//! the result. A new value changes the nodes above it, one for each doubling of the window: the same work in every cycle,
//! and no sum that drifts. Tangwongsan, Hirzel, Schneider, Wu: "General incremental sliding-window aggregation", PVLDB 8
//! (2015), section 4 (FlatFAT). The real-time thread.

use super::{Parameter, ParameterKind, Port, Spec, State, UnitRule, each};
use crate::frame::Frame;

/// What every window of numbers has in common: one rule for null, the same types. A primitive adds its name, its words, its
/// worked values, and the memory with what an empty window combines to.
pub const WINDOW: Spec = Spec {
    null: "null while a null value is in the window, element by element; before the window is full it is over what there was",
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
        "how long the window is, with the value of now; 1 to 10 000 cycles of the net",
    )
    .above(0.0)],
    // the place of the next value, the number of values so far
    state: State {
        ints: 2,
        ..State::NONE
    },
    ..Spec::PLAIN
};

/// What a window does with its values.
pub trait Fold {
    /// What becomes of a value before it is combined with others; NaN must stay NaN.
    fn leaf(value: f64) -> f64;
    /// Combines two; NaN must come out if NaN goes in.
    fn combine(a: f64, b: f64) -> f64;
    /// The result from the root and the number of values.
    fn result(root: f64, count: f64) -> f64;
}

/// `[in, out, ints, tree, width, cycles]`: one tree of `2 · cycles` nodes for each element. Of the two Ints the first one
/// is the place of the next value, the second one the number of values so far, at most `cycles`.
#[inline(always)]
pub fn each_window<F: Fold>(frame: &mut Frame<'_>, operands: &[u32]) {
    each(frame, operands, step::<F>);
}

fn step<F: Fold>(
    frame: &mut Frame<'_>,
    [input, out, ints, tree, width, cycles]: [u32; 6],
) -> Option<()> {
    let place = u32::try_from(frame.get_int(ints)?).ok()?;
    let place = place.min(cycles.saturating_sub(1));
    let count = frame
        .get_int(ints + 1)?
        .saturating_add(1)
        .min(i64::from(cycles));
    for i in 0..width {
        let tree = tree + i * 2 * cycles;
        let value = frame.get_real(input + i)?;
        let mut node = cycles + place;
        frame.put_real(tree + node, F::leaf(value))?;
        // At most one step for each bit of the window's length.
        for _ in 0..u32::BITS {
            if node < 2 {
                break;
            }
            node /= 2;
            let (a, b) = (
                frame.get_real(tree + 2 * node)?,
                frame.get_real(tree + 2 * node + 1)?,
            );
            frame.put_real(tree + node, F::combine(a, b))?;
        }
        let root = frame.get_real(tree + 1)?;
        frame.put_real(out + i, F::result(root, count as f64))?;
    }
    frame.put_int(ints + 1, count)?;
    let next = if place + 1 < cycles { place + 1 } else { 0 };
    frame.put_int(ints, i64::from(next))
}
