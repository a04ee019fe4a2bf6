//! `MinElement`: the smallest element of an array.

use crate::frame::Frame;
use crate::primitive::{
    Dim, Elements, Entry, Example, Kernel, Port, PortType, Spec, UnitRule, choose, each,
};
use crate::types::{NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "MinElement",
        summary: "The smallest element of an array.",
        null: "a null element gives null",
        undefined: "",
        inputs: &[Port::new(
            "in",
            PortType::Array(Elements::Open, Dim::Var(0)),
            UnitRule::Var(0),
            "an array of numbers",
        )],
        outputs: &[Port::number("out", UnitRule::Var(0), "result")],
        examples: &[Example::new(
            "an array with a null element",
            "",
            "in | out
             [1.5, 2.0, -4.0] | -4.0
             [1.5, null, -4.0] | null",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, step_real);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, step_int);
        }),
    ],
);

#[inline(always)]
fn step_real(frame: &mut Frame<'_>, [input, out, length]: [u32; 3]) -> Option<()> {
    let mut result = frame.get_real(input)?;
    for i in 1..length {
        let value = frame.get_real(input + i)?;
        result = if result.is_nan() | (result < value) {
            result
        } else {
            value
        };
    }
    frame.put_real(out, result)
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, out, length]: [u32; 3]) -> Option<()> {
    let mut result = frame.get_int(input)?;
    let mut null = result == NULL_INT;
    for i in 1..length {
        let value = frame.get_int(input + i)?;
        let (next, out_of_range) = (result.min(value), false);
        null |= (value == NULL_INT) | out_of_range;
        result = next;
    }
    frame.put_int(out, choose(null, NULL_INT, result))
}
