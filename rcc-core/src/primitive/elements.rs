//! What primitives that make one value of an array have in common: their ports, and the fold from the first element to the
//! last. The specs are read by the loader, the kernels by the real-time thread.

use super::{Dim, Elements, Port, PortType, Spec, UnitRule, choose, each};
use crate::frame::Frame;
use crate::types::{NULL_BOOL, NULL_INT, Type};

/// One number of an array of numbers.
pub const ELEMENTS: Spec = Spec {
    null: "a null element gives null",
    inputs: &[Port::new(
        "in",
        PortType::Array(Elements::Open, Dim::Var(0)),
        UnitRule::Var(0),
        "an array of numbers",
    )],
    outputs: &[Port::number("out", UnitRule::Var(0), "result")],
    ..Spec::PLAIN
};

/// One truth value of an array of them; a primitive says what its output means.
pub const TRUTHS: Spec = Spec {
    null: "a null element gives null",
    inputs: &[Port::new(
        "in",
        PortType::Array(Elements::Are(Type::Bool), Dim::Var(0)),
        UnitRule::Typed,
        "truth values",
    )],
    ..Spec::PLAIN
};

/// `Real[n] → Real`; NaN must come out if NaN goes in.
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

/// `Int[n] → Int`: null if an element is null, or if the operation says that its result is out of range.
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

/// `Bool[n] → Bool`, by the lowest bit, beginning with `first`: null if an element is null.
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
