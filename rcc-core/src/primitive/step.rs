//! Iteration over runs of equal primitives: one dispatch, then the same step for each group of operands. Steps contain
//! no branch that depends on values: null is selected, not branched on. Run by the real-time thread.

use super::{
    Bool, ByElement, Element, Int, Kernel, Operands, Real, Slot, Step, choose, int_unless,
    operands, real_unless, whole,
};
use crate::frame::Frame;
use crate::types::{NULL_BOOL, Store};

/// Calls `step` for each group of operands: one dispatch for a whole run of equal primitives. `None`, for a slot outside
/// its arena, ends the run. `Plan::check` excludes such slots; because no fallback value is needed for them, a step
/// compiles to straight-line code.
#[inline(always)]
pub fn each<O: Operands>(
    frame: &mut Frame<'_>,
    operands: &[u32],
    step: impl Fn(&mut Frame<'_>, O) -> Option<()>,
) {
    let mut rest = operands;
    while let Some((group, after)) = O::split(rest) {
        if step(frame, group).is_none() {
            return;
        }
        rest = after;
    }
}

/// Evaluates each group of operands by `S`.
#[inline(always)]
pub fn each_step<S: Step>(frame: &mut Frame<'_>, operands: &[u32]) {
    each(frame, operands, |frame, step: S| step.step(frame));
}

/// Evaluates each group of operands by `S`, element by element: the width follows the operands of `S`.
#[inline(always)]
pub fn each_element<S: ByElement>(frame: &mut Frame<'_>, operands: &[u32]) {
    let mut rest = operands;
    while let Some((group, [width, after @ ..])) = S::split(rest) {
        for i in 0..*width {
            if group.element(i).step(frame).is_none() {
                return;
            }
        }
        rest = after;
    }
}

operands! {
    struct Unary<E> { input: Slot<E>, out: Slot<E> }
}

operands! {
    struct ToInt { input: Slot<Real>, out: Slot<Int> }
}

operands! {
    struct Compare<E> { a: Slot<E>, b: Slot<E>, out: Slot<Bool> }
}

operands! {
    struct Pair<E> { a: Slot<E>, b: Slot<E>, out: Slot<E> }
}

operands! {
    struct WidePair<E> { a: Slot<E>, b: Slot<E>, out: Slot<E>, width: u32 }
}

/// An operation on two values of one type; null if an operand is null.
pub trait Operation<E>: Copy {
    /// Returns the result.
    fn apply(a: E, b: E) -> E;
}

/// Applies an operation to two values of one element.
#[inline(always)]
pub fn each_pair<E: Element, O: Operation<E>>(frame: &mut Frame<'_>, operands: &[u32]) {
    each(frame, operands, |frame, pair: Pair<E>| {
        let result = O::apply(frame.get(pair.a)?, frame.get(pair.b)?);
        frame.put(pair.out, result)
    });
}

#[inline(always)]
fn each_wide_pair<E: Element, O: Operation<E>>(frame: &mut Frame<'_>, operands: &[u32]) {
    each(frame, operands, |frame, pair: WidePair<E>| {
        for i in 0..pair.width {
            let result = O::apply(frame.get(pair.a + i)?, frame.get(pair.b + i)?);
            frame.put(pair.out + i, result)?;
        }
        Some(())
    });
}

/// The kernels of an operation on two numbers, vectors, arrays or matrices, element by element.
pub const fn by_element<O: Operation<Real> + Operation<Int>>() -> [Kernel; 4] {
    [
        Kernel::single(Store::Real, each_pair::<Real, O>),
        Kernel::of(Store::Real, each_wide_pair::<Real, O>),
        Kernel::single(Store::Int, each_pair::<Int, O>),
        Kernel::of(Store::Int, each_wide_pair::<Int, O>),
    ]
}

/// `Real → Real`: null if the operand is null, or if the result is not finite.
#[inline(always)]
pub fn map_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64) -> f64) {
    each(frame, operands, |frame, map: Unary<Real>| {
        let result = operation(frame.get(map.input)?);
        frame.put(map.out, result)
    });
}

/// `Real → Int`: null if the operand is null, or if the result is out of range; `operation` returns an integral value.
#[inline(always)]
pub fn map_whole(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64) -> f64) {
    each(frame, operands, |frame, map: ToInt| {
        let result = operation(frame.get(map.input)?);
        frame.put(map.out, whole(result))
    });
}

/// `Real, Real → Real`: null if either is null, or if the result is not finite.
#[inline(always)]
pub fn each_finite(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> f64) {
    each(frame, operands, |frame, pair: Pair<Real>| {
        let (a, b) = (frame.get(pair.a)?, frame.get(pair.b)?);
        let result = operation(a, b);
        frame.put(pair.out, real_unless(a.is_nan() | b.is_nan(), result))
    });
}

/// `Int, Int → Int`: null if either is null, or if `operation` flags its result as out of range.
#[inline(always)]
pub fn each_int(
    frame: &mut Frame<'_>,
    operands: &[u32],
    operation: impl Fn(i64, i64) -> (i64, bool),
) {
    each(frame, operands, |frame, pair: Pair<Int>| {
        let (a, b) = (frame.get(pair.a)?, frame.get(pair.b)?);
        frame.put(pair.out, int_unless(a, b, operation(a, b)))
    });
}

/// `Bool, Bool → Bool`, by the lowest bit: null if either is null.
#[inline(always)]
pub fn each_bool(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(u8, u8) -> u8) {
    each(frame, operands, |frame, logic: Pair<Bool>| {
        let (a, b) = (frame.get(logic.a)?, frame.get(logic.b)?);
        // Bit 1 is the null flag, bit 0 the value; a null has no value bit.
        let null = (a | b) & NULL_BOOL;
        let value = operation(a, b) & !(null >> 1) & 1;
        frame.put(logic.out, null | value)
    });
}

/// Two numbers → `Bool`: null if either is null.
#[inline(always)]
pub fn compare<E: Element>(
    frame: &mut Frame<'_>,
    operands: &[u32],
    operation: impl Fn(E, E) -> bool,
) {
    each(frame, operands, |frame, compare: Compare<E>| {
        let (a, b) = (frame.get(compare.a)?, frame.get(compare.b)?);
        let result = u8::from(operation(a, b));
        frame.put(
            compare.out,
            choose(a.is_null() | b.is_null(), NULL_BOOL, result),
        )
    });
}
