//! Iteration over runs of equal primitives: one dispatch, then the same step for each group of operands. Steps contain
//! no branch that depends on values: null is selected, not branched on. Run by the real-time thread.

use crate::frame::Frame;
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL};

/// The result of a step: `()`, or `None` for a slot outside its arena, which ends the run. `Plan::check` excludes such
/// slots; because no fallback value is needed for them, a step compiles to straight-line code.
pub trait StepResult {
    /// Returns false to end the run.
    fn continues(self) -> bool;
}

impl StepResult for () {
    #[inline(always)]
    fn continues(self) -> bool {
        true
    }
}

impl StepResult for Option<()> {
    #[inline(always)]
    fn continues(self) -> bool {
        self.is_some()
    }
}

/// Calls `step` for each group of `N` operands: one dispatch for a whole run of equal primitives.
#[inline(always)]
pub fn each<const N: usize, R: StepResult>(
    frame: &mut Frame<'_>,
    operands: &[u32],
    step: impl Fn(&mut Frame<'_>, [u32; N]) -> R,
) {
    let mut rest = operands;
    while let Some((group, after)) = rest.split_first_chunk() {
        if !step(frame, *group).continues() {
            return;
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
#[inline(always)]
pub fn finite(value: f64) -> f64 {
    real_unless(!value.is_finite(), value)
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

/// `Real → Real`: null if the operand is null, or if the result is not finite.
#[inline(always)]
pub fn map_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64) -> f64) {
    each(frame, operands, |frame, [input, out]| {
        let result = operation(frame.get_real(input)?);
        frame.put_real(out, finite(result))
    });
}

/// `Real → Int`: null if the operand is null, or if the result is out of range; `operation` returns an integral value.
#[inline(always)]
pub fn map_whole(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64) -> f64) {
    each(frame, operands, |frame, [input, out]| {
        let result = operation(frame.get_real(input)?);
        frame.put_int(out, whole(result))
    });
}

/// `Real, Real → Real`: null if either is null, or if the result is not finite.
#[inline(always)]
pub fn each_finite(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> f64) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.get_real(a)?, frame.get_real(b)?);
        let result = operation(a, b);
        frame.put_real(out, real_unless(a.is_nan() | b.is_nan(), finite(result)))
    });
}

/// `Real, Real → Real`; `operation` must return NaN if an operand is NaN.
#[inline(always)]
pub fn each_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> f64) {
    each(frame, operands, |frame, [a, b, out]| {
        let result = operation(frame.get_real(a)?, frame.get_real(b)?);
        frame.put_real(out, result)
    });
}

/// `Int, Int → Int`: null if either is null, or if `operation` flags its result as out of range.
#[inline(always)]
pub fn each_int(
    frame: &mut Frame<'_>,
    operands: &[u32],
    operation: impl Fn(i64, i64) -> (i64, bool),
) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.get_int(a)?, frame.get_int(b)?);
        let (result, out_of_range) = operation(a, b);
        let null = (a == NULL_INT) | (b == NULL_INT) | out_of_range;
        frame.put_int(out, choose(null, NULL_INT, result))
    });
}

/// `Bool, Bool → Bool`, by the lowest bit: null if either is null.
#[inline(always)]
pub fn each_bool(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(u8, u8) -> u8) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.get_bool(a)?, frame.get_bool(b)?);
        // Bit 1 is the null flag, bit 0 the value; a null has no value bit.
        let null = (a | b) & NULL_BOOL;
        let value = operation(a, b) & !(null >> 1) & 1;
        frame.put_bool(out, null | value)
    });
}

/// `Real, Real → Bool`: null if either is null.
#[inline(always)]
pub fn compare_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> bool) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.get_real(a)?, frame.get_real(b)?);
        let result = u8::from(operation(a, b));
        let null = a.is_nan() | b.is_nan();
        frame.put_bool(out, choose(null, NULL_BOOL, result))
    });
}

/// `Int, Int → Bool`: null if either is null.
#[inline(always)]
pub fn compare_int(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(i64, i64) -> bool) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.get_int(a)?, frame.get_int(b)?);
        let result = u8::from(operation(a, b));
        let null = (a == NULL_INT) | (b == NULL_INT);
        frame.put_bool(out, choose(null, NULL_BOOL, result))
    });
}
