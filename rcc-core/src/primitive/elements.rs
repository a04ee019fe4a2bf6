//! Shared parts of primitives that reduce an array to one value: their ports, and the fold from the first element to
//! the last. The specs are read by the loader, the kernels by the real-time thread.

use super::{Dim, ElementType, Port, PortType, Spec, UnitRule, choose, each};
use crate::frame::Frame;
use crate::types::{NULL_BOOL, NULL_INT, Type};

/// Spec of a primitive that reduces an array of numbers to one number.
pub const ELEMENTS: Spec = Spec {
    null: "a null element gives null",
    inputs: &[Port::new(
        "in",
        PortType::Array(ElementType::Open, Dim::Var(0)),
        UnitRule::Var(0),
        "an array of numbers",
    )],
    outputs: &[Port::number("out", UnitRule::Var(0), "result")],
    ..Spec::PLAIN
};

/// Spec of a primitive that reduces an array of Bools; the primitive adds its output.
pub const TRUTHS: Spec = Spec {
    null: "a null element gives null",
    inputs: &[Port::new(
        "in",
        PortType::Array(ElementType::Are(Type::Bool), Dim::Var(0)),
        UnitRule::Typed,
        "an array of Bools",
    )],
    ..Spec::PLAIN
};

/// `Real[n] → Real`; `operation` must return NaN if an operand is NaN.
#[inline(always)]
pub fn fold_real(frame: &mut Frame<'_>, operands: &[u32], operation: impl Fn(f64, f64) -> f64) {
    each(frame, operands, |frame, [input, out, length]| {
        let mut result = frame.get_real(input)?;
        for i in 1..length {
            result = operation(result, frame.get_real(input + i)?);
        }
        frame.put_real(out, result)
    });
}

/// `Int[n] → Int`: null if an element is null, or if `operation` flags its result as out of range.
#[inline(always)]
pub fn fold_int(
    frame: &mut Frame<'_>,
    operands: &[u32],
    operation: impl Fn(i64, i64) -> (i64, bool),
) {
    each(frame, operands, |frame, [input, out, length]| {
        let mut result = frame.get_int(input)?;
        let mut null = result == NULL_INT;
        for i in 1..length {
            let value = frame.get_int(input + i)?;
            let (next, out_of_range) = operation(result, value);
            null |= (value == NULL_INT) | out_of_range;
            result = next;
        }
        frame.put_int(out, choose(null, NULL_INT, result))
    });
}

/// `Bool[n] → Bool` on the lowest bit, starting with `first`: null if an element is null.
#[inline(always)]
pub fn fold_bool(
    frame: &mut Frame<'_>,
    operands: &[u32],
    first: u8,
    operation: impl Fn(u8, u8) -> u8,
) {
    each(frame, operands, |frame, [input, out, length]| {
        let (mut result, mut null) = (first, 0);
        for i in 0..length {
            let value = frame.get_bool(input + i)?;
            null |= value & NULL_BOOL;
            result = operation(result, value & 1);
        }
        frame.put_bool(out, choose(null != 0, NULL_BOOL, result))
    });
}
