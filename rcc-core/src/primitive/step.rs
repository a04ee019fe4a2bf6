//! Runs of equal primitives: one dispatch, then the same step for each group of operands. Steps have no branch that
//! depends on values: null is chosen, not jumped to. The real-time thread.

use crate::frame::Frame;
use crate::types::{NULL_BOOL, NULL_INT};

/// Calls `step` for each group of `N` operands: one dispatch for a whole run of equal primitives.
#[inline(always)]
pub fn each<const N: usize>(
    frame: &mut Frame<'_>,
    operands: &[u32],
    step: impl Fn(&mut Frame<'_>, [u32; N]),
) {
    let (groups, _) = operands.as_chunks::<N>();
    for group in groups {
        step(frame, *group);
    }
}

/// `Real, Real → Real`; NaN must come out if NaN goes in.
#[inline(always)]
pub fn each_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> f64) {
    each(frame, operands, |frame, [a, b, out]| {
        let result = operation(frame.real(a), frame.real(b));
        frame.set_real(out, result);
    });
}

/// `Int, Int → Int`: null if either is null, or if the operation says that its result is out of range.
#[inline(always)]
pub fn each_int(
    frame: &mut Frame<'_>,
    operands: &[u32],
    operation: impl Fn(i64, i64) -> (i64, bool),
) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.int(a), frame.int(b));
        let (result, out_of_range) = operation(a, b);
        let null = (a == NULL_INT) | (b == NULL_INT) | out_of_range;
        frame.set_int(out, if null { NULL_INT } else { result });
    });
}

/// `Real, Real → Bool`: null if either is null.
#[inline(always)]
pub fn compare_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> bool) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.real(a), frame.real(b));
        let result = u8::from(operation(a, b));
        let null = a.is_nan() | b.is_nan();
        frame.set_bool(out, if null { NULL_BOOL } else { result });
    });
}

/// `Int, Int → Bool`: null if either is null.
#[inline(always)]
pub fn compare_int(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(i64, i64) -> bool) {
    each(frame, operands, |frame, [a, b, out]| {
        let (a, b) = (frame.int(a), frame.int(b));
        let result = u8::from(operation(a, b));
        let null = (a == NULL_INT) | (b == NULL_INT);
        frame.set_bool(out, if null { NULL_BOOL } else { result });
    });
}
