//! Selections, limits and conversions of single values without a branch: null is selected, not branched on. Run by the
//! real-time thread.

use crate::types::{NULL_INT, NULL_REAL};

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
    choose(
        (a == NULL_INT) | (b == NULL_INT) | out_of_range,
        NULL_INT,
        result,
    )
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
