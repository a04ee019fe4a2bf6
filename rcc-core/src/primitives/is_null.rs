//! `IsNull`: true if a value of any type is null. Its output is never null.
//!
//! An array or composite counts as null if any of its elements is.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, NullRule, Port, PortType, Spec, UnitRule, each, is_null,
};
use crate::types::{NULL_BOOL, NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "IsNull",
        summary: "True while its input is null.",
        null: "a null input gives true, and so does an array or vector with a null element; the output is never null",
        null_rule: NullRule::Known,
        examples: &[Example::new(
            "a number that is null for one cycle",
            "",
            "in | out
             0.5 | false
             null | true
             0.0 | false",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Any,
            UnitRule::Var(0),
            "value to test",
        )],
        outputs: &[Port::bool("out", "in is null")],
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
fn step_real(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_real(input)?;
    frame.put_bool(out, u8::from(value.is_nan()))
}

#[inline(always)]
fn step_bool(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_bool(input)?;
    frame.put_bool(out, u8::from(value & NULL_BOOL != 0))
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_int(input)?;
    frame.put_bool(out, u8::from(value == NULL_INT))
}

#[inline]
fn wide_real(frame: &mut Frame<'_>, [input, out, width]: [u32; 3]) {
    if let Some(null) = is_null(frame, Store::Real, input, width) {
        frame.set_bool(out, u8::from(null));
    }
}

#[inline]
fn wide_bool(frame: &mut Frame<'_>, [input, out, width]: [u32; 3]) {
    if let Some(null) = is_null(frame, Store::Bool, input, width) {
        frame.set_bool(out, u8::from(null));
    }
}

#[inline]
fn wide_int(frame: &mut Frame<'_>, [input, out, width]: [u32; 3]) {
    if let Some(null) = is_null(frame, Store::Int, input, width) {
        frame.set_bool(out, u8::from(null));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn detects_null_in_every_arena() {
        let mut bench = PrimitiveHarness::wide("IsNull", Some(Store::Real), 7);
        assert_eq!(bench.step().bool("out"), Some(true));
        assert_eq!(
            bench.set_reals("in", &[0.0; 7]).step().bool("out"),
            Some(false)
        );
        let mut bench = PrimitiveHarness::wide("IsNull", Some(Store::Bool), 1);
        assert_eq!(bench.set_bool("in", None).step().bool("out"), Some(true));
        assert_eq!(
            bench.set_bool("in", Some(false)).step().bool("out"),
            Some(false)
        );
        let mut bench = PrimitiveHarness::wide("IsNull", Some(Store::Int), 1);
        assert_eq!(bench.set_int("in", NULL_INT).step().bool("out"), Some(true));
        assert_eq!(bench.set_int("in", 0).step().bool("out"), Some(false));
    }
}
