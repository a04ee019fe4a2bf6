//! `Scale`: out = in · factor, each element rounded once; an `Int` overflow gives null.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, choose, each, each_int,
    each_real,
};
use crate::types::{NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Scale",
        summary: "A number, vector, array or matrix times a number; its unit is the product of theirs.",
        null: "a null element gives a null element, a null factor gives null in all elements",
        undefined: "overflow of integers",
        inputs: &[
            Port::linear("in", UnitRule::Var(0), "value to scale"),
            Port::new("factor", PortType::Part, UnitRule::Var(1), "factor"),
        ],
        outputs: &[Port::linear("out", UnitRule::Product(0, 1), "in · factor")],
        examples: &[
            Example::new(
                "an array",
                "",
                "in | factor | out
                 [1.0, -2.0, 0.5] | 2.0 | [2.0, -4.0, 1.0]
                 [1.0, -2.0, 0.5] | null | null",
            ),
            Example::new("a number", "", "in | factor | out\n 3.0 | 0.5 | 1.5"),
        ],
        ..Spec::PLAIN
    },
    &[
        Kernel::single(Store::Real, |frame, operands| {
            each_real(frame, operands, |a, b| a * b);
        }),
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, wide_real);
        }),
        Kernel::single(Store::Int, |frame, operands| {
            each_int(frame, operands, i64::overflowing_mul);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, wide_int);
        }),
    ],
);

#[inline(always)]
fn wide_real(frame: &mut Frame<'_>, [input, factor, out, width]: [u32; 4]) -> Option<()> {
    let factor = frame.get_real(factor)?;
    for i in 0..width {
        let value = frame.get_real(input + i)?;
        frame.put_real(out + i, value * factor)?;
    }
    Some(())
}

#[inline(always)]
fn wide_int(frame: &mut Frame<'_>, [input, factor, out, width]: [u32; 4]) -> Option<()> {
    let factor = frame.get_int(factor)?;
    for i in 0..width {
        let value = frame.get_int(input + i)?;
        let (product, out_of_range) = value.overflowing_mul(factor);
        let null = (value == NULL_INT) | (factor == NULL_INT) | out_of_range;
        frame.put_int(out + i, choose(null, NULL_INT, product))?;
    }
    Some(())
}
