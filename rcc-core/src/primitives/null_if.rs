//! `NullIf`: a value of any type, or null while a condition is true.
//!
//! `NullIf` produces null, `OrElse` replaces it and `IsNull` tests for it.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, choose, each, real_unless,
};
use crate::types::{NULL_BOOL, NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "NullIf",
        summary: "A value, or null while a condition is true.",
        null: "a null value gives null, and so does a null condition",
        undefined: "the condition is true",
        examples: &[Example::new(
            "a number, unless the condition is true or null",
            "",
            "in | condition | out
                 1.5 | false | 1.5
                 1.5 | true | null
                 1.5 | null | null
                 null | false | null",
        )],
        inputs: &[
            Port::new("in", PortType::Any, UnitRule::Var(0), "value to pass on"),
            Port::bool("condition", "while true, the output is null"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "the input, or null",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::single(Store::Real, |frame, operands| {
            each(frame, operands, step_real);
        }),
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, wide_real);
        }),
        Kernel::single(Store::Bool, |frame, operands| {
            each(frame, operands, step_bool);
        }),
        Kernel::of(Store::Bool, |frame, operands| {
            each(frame, operands, wide_bool);
        }),
        Kernel::single(Store::Int, |frame, operands| {
            each(frame, operands, step_int);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, wide_int);
        }),
    ],
);

#[inline(always)]
fn step_real(frame: &mut Frame<'_>, [input, condition, out]: [u32; 3]) -> Option<()> {
    let (value, condition) = (frame.get_real(input)?, frame.get_bool(condition)?);
    frame.put_real(out, real_unless(condition != 0, value))
}

#[inline]
fn wide_real(frame: &mut Frame<'_>, [input, condition, out, width]: [u32; 4]) -> Option<()> {
    for i in 0..width {
        step_real(frame, [input + i, condition, out + i])?;
    }
    Some(())
}

#[inline(always)]
fn step_bool(frame: &mut Frame<'_>, [input, condition, out]: [u32; 3]) -> Option<()> {
    let (value, condition) = (frame.get_bool(input)?, frame.get_bool(condition)?);
    frame.put_bool(out, choose(condition != 0, NULL_BOOL, value))
}

#[inline]
fn wide_bool(frame: &mut Frame<'_>, [input, condition, out, width]: [u32; 4]) -> Option<()> {
    for i in 0..width {
        step_bool(frame, [input + i, condition, out + i])?;
    }
    Some(())
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, condition, out]: [u32; 3]) -> Option<()> {
    let (value, condition) = (frame.get_int(input)?, frame.get_bool(condition)?);
    frame.put_int(out, choose(condition != 0, NULL_INT, value))
}

#[inline]
fn wide_int(frame: &mut Frame<'_>, [input, condition, out, width]: [u32; 4]) -> Option<()> {
    for i in 0..width {
        step_int(frame, [input + i, condition, out + i])?;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn only_a_false_condition_passes_the_value() {
        for width in [1, 2] {
            let mut bench = PrimitiveHarness::wide("NullIf", Some(Store::Real), width);
            bench.set_real("in", 2.0);
            assert_eq!(
                bench.set_bool("condition", Some(false)).step().real("out"),
                2.0
            );
            for condition in [Some(true), None] {
                let out = bench.set_bool("condition", condition).step().real("out");
                assert!(out.is_nan(), "{condition:?}");
            }
            let mut bench = PrimitiveHarness::wide("NullIf", Some(Store::Bool), width);
            bench.set_bool("in", Some(true));
            assert_eq!(
                bench.set_bool("condition", Some(false)).step().bool("out"),
                Some(true)
            );
            assert_eq!(
                bench.set_bool("condition", Some(true)).step().bool("out"),
                None
            );
            let mut bench = PrimitiveHarness::wide("NullIf", Some(Store::Int), width);
            bench.set_int("in", 3);
            assert_eq!(
                bench.set_bool("condition", Some(false)).step().int("out"),
                3
            );
            assert_eq!(
                bench.set_bool("condition", None).step().int("out"),
                NULL_INT
            );
        }
    }
}
