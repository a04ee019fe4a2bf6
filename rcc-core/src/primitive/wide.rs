//! Element-wise steps over values of several elements. Null is per element in arrays and matrices; a value counts as
//! null as a whole if any element is null. Run by the real-time thread.

use super::{choose, each};
use crate::frame::Frame;
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};

/// `Real[n], Real[n] → Real[n]`, element by element; `operation` must return NaN if an operand is NaN.
#[inline(always)]
pub fn wide_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> f64) {
    each(frame, operands, |frame, [a, b, out, width]| {
        for i in 0..width {
            let result = operation(frame.get_real(a + i)?, frame.get_real(b + i)?);
            frame.put_real(out + i, result)?;
        }
        Some(())
    });
}

/// `Int[n], Int[n] → Int[n]`, element by element; null if either operand is null, or if `operation` flags its result as
/// out of range.
#[inline(always)]
pub fn wide_int(
    frame: &mut Frame<'_>,
    operands: &[u32],
    operation: impl Fn(i64, i64) -> (i64, bool),
) {
    each(frame, operands, |frame, [a, b, out, width]| {
        for i in 0..width {
            let (a, b) = (frame.get_int(a + i)?, frame.get_int(b + i)?);
            let (result, out_of_range) = operation(a, b);
            let null = (a == NULL_INT) | (b == NULL_INT) | out_of_range;
            frame.put_int(out + i, choose(null, NULL_INT, result))?;
        }
        Some(())
    });
}

/// Copies `width` elements; `None` if a slot is outside the arena.
#[inline(always)]
pub fn copy(frame: &mut Frame<'_>, store: Store, from: u32, to: u32, width: u32) -> Option<()> {
    for i in 0..width {
        match store {
            Store::Real => {
                let value = frame.get_real(from + i)?;
                frame.put_real(to + i, value)?;
            }
            Store::Bool => {
                let value = frame.get_bool(from + i)?;
                frame.put_bool(to + i, value)?;
            }
            Store::Int => {
                let value = frame.get_int(from + i)?;
                frame.put_int(to + i, value)?;
            }
        }
    }
    Some(())
}

/// Writes null into `width` elements; `None` if a slot is outside the arena.
#[inline(always)]
pub fn fill_null(frame: &mut Frame<'_>, store: Store, to: u32, width: u32) -> Option<()> {
    for i in 0..width {
        match store {
            Store::Real => frame.put_real(to + i, NULL_REAL)?,
            Store::Bool => frame.put_bool(to + i, NULL_BOOL)?,
            Store::Int => frame.put_int(to + i, NULL_INT)?,
        }
    }
    Some(())
}

/// Returns true if any of `width` elements is null; `None` if a slot is outside the arena.
#[inline(always)]
pub fn is_null(frame: &Frame<'_>, store: Store, slot: u32, width: u32) -> Option<bool> {
    let mut null = false;
    for i in 0..width {
        null |= match store {
            Store::Real => frame.get_real(slot + i)?.is_nan(),
            Store::Bool => frame.get_bool(slot + i)? & NULL_BOOL != 0,
            Store::Int => frame.get_int(slot + i)? == NULL_INT,
        };
    }
    Some(null)
}
