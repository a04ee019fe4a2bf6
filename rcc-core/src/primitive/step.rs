//! Iteration over runs of equal primitives: one dispatch, then the same step for each group of operands. Steps contain
//! no branch that depends on values: null is selected, not branched on. Run by the real-time thread.

use super::{Bool, ByElement, Element, Int, Kernel, Operands, Real, Slot, Step, operands};
use crate::frame::Frame;
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};

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

/// Selects one of two values without a branch: the condition is often close to random, and a mispredicted branch costs
/// more than ten primitives.
#[inline(always)]
pub fn choose<T>(condition: bool, yes: T, no: T) -> T {
    core::hint::select_unpredictable(condition, yes, no)
}

/// Returns `value`, or null if `null` is true, without a branch: the bits of [`NULL_REAL`] are OR-ed in, which makes
/// any number a NaN.
#[inline(always)]
pub fn real_unless(null: bool, value: f64) -> f64 {
    f64::from_bits(value.to_bits() | choose(null, NULL_REAL.to_bits(), 0))
}

/// Returns `value`, or null if it is infinite: an overflow, or an operation on infinity, has no meaningful result.
///
/// The difference is +0, or NaN for an infinite number (IEEE 754, section 7.2); its bits are OR-ed in. Every store of a
/// number waits for this: two operations, where a comparison and a selection are four.
#[inline(always)]
pub fn finite(value: f64) -> f64 {
    #[expect(clippy::eq_op, reason = "not zero for an infinite number")]
    let zero = value - value;
    f64::from_bits(value.to_bits() | zero.to_bits())
}

/// Returns the lower of two numbers, the first if they are equal; a null operand is ignored. (`f64::min` does not
/// specify which zero it returns.)
#[inline(always)]
pub fn lower(a: f64, b: f64) -> f64 {
    if a.is_nan() | (b < a) { b } else { a }
}

/// Returns the higher of two numbers, the first if they are equal; a null operand is ignored.
#[inline(always)]
pub fn higher(a: f64, b: f64) -> f64 {
    if a.is_nan() | (b > a) { b } else { a }
}

/// Returns `value` limited to `low..=high`. A null limit does not limit; `low > high` gives NaN.
#[inline(always)]
pub fn within(value: f64, low: f64, high: f64) -> f64 {
    let limited = if value > high {
        high
    } else if value < low {
        low
    } else {
        value
    };
    real_unless(low > high, limited)
}

/// Converts an integral `value` to `Int`; null if it is NaN or beyond ±(2^63 − 1).
#[inline(always)]
pub fn whole(value: f64) -> i64 {
    const BOUND: f64 = 9_223_372_036_854_775_808.0;
    let in_range = (value > -BOUND) & (value < BOUND);
    // The cast saturates, and converts NaN to 0.
    choose(in_range, value as i64, NULL_INT)
}

/// Returns `result`, or null if an operand is null or the result is out of range, without a branch.
#[inline(always)]
pub fn int_unless(a: i64, b: i64, (result, out_of_range): (i64, bool)) -> i64 {
    choose(a.is_null() | b.is_null() | out_of_range, NULL_INT, result)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finite_number_keeps_its_bits_and_an_infinite_one_is_null() {
        let numbers = [0.0, 1.0, 5e-324, f64::MIN_POSITIVE, 1.0 / 3.0, f64::MAX];
        for number in numbers.into_iter().flat_map(|number| [number, -number]) {
            assert_eq!(finite(number).to_bits(), number.to_bits(), "{number}");
        }
        for number in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN, NULL_REAL] {
            assert!(finite(number).is_nan(), "{number}");
        }
    }
}
