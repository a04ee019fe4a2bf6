//! `OrElse`: a value, or a replacement while it is null.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, NullRule, Port, PortType, Spec, UnitRule, choose, each,
    is_null,
};
use crate::types::{NULL_BOOL, NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "OrElse",
        summary: "A value, or a replacement while the first is null.",
        null: "a null `in`, or one with a null element, gives `other`; null only if both are null",
        null_rule: NullRule::AnyKnown,
        examples: &[Example::new(
            "the replacement while the first is null",
            "",
            "in | other | out
             0.5 | 9.5 | 0.5
             null | 9.5 | 9.5
             null | null | null",
        )],
        inputs: &[
            Port::new("in", PortType::Any, UnitRule::Var(0), "primary value"),
            Port::new("other", PortType::Any, UnitRule::Var(0), "replacement"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "`in`, or `other`",
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
fn step_real(frame: &mut Frame<'_>, [input, other, out]: [u32; 3]) -> Option<()> {
    let value = frame.get_real(input)?;
    let value = frame.get_real(choose(value.is_nan(), other, input))?;
    frame.put_real(out, value)
}

#[inline(always)]
fn step_bool(frame: &mut Frame<'_>, [input, other, out]: [u32; 3]) -> Option<()> {
    let value = frame.get_bool(input)?;
    let value = frame.get_bool(choose(value & NULL_BOOL != 0, other, input))?;
    frame.put_bool(out, value)
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, other, out]: [u32; 3]) -> Option<()> {
    let value = frame.get_int(input)?;
    let value = frame.get_int(choose(value == NULL_INT, other, input))?;
    frame.put_int(out, value)
}

#[inline]
fn wide_real(frame: &mut Frame<'_>, [input, other, out, width]: [u32; 4]) {
    let null = is_null(frame, Store::Real, input, width).unwrap_or(true);
    let source = if null { other } else { input };
    for i in 0..width {
        let value = frame.real(source + i);
        frame.set_real(out + i, value);
    }
}

#[inline]
fn wide_bool(frame: &mut Frame<'_>, [input, other, out, width]: [u32; 4]) {
    let null = is_null(frame, Store::Bool, input, width).unwrap_or(true);
    let source = if null { other } else { input };
    for i in 0..width {
        let value = frame.bool(source + i);
        frame.set_bool(out + i, value);
    }
}

#[inline]
fn wide_int(frame: &mut Frame<'_>, [input, other, out, width]: [u32; 4]) {
    let null = is_null(frame, Store::Int, input, width).unwrap_or(true);
    let source = if null { other } else { input };
    for i in 0..width {
        let value = frame.int(source + i);
        frame.set_int(out + i, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn replaces_null_and_nothing_else() {
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Real), 1);
        assert_eq!(
            bench
                .set_real("in", f64::NAN)
                .set_real("other", 2.0)
                .step()
                .real("out"),
            2.0
        );
        assert_eq!(bench.set_real("in", 1.0).step().real("out"), 1.0);
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Bool), 1);
        assert_eq!(
            bench
                .set_bool("in", None)
                .set_bool("other", Some(true))
                .step()
                .bool("out"),
            Some(true)
        );
        assert_eq!(
            bench.set_bool("in", Some(false)).step().bool("out"),
            Some(false)
        );
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Int), 1);
        assert_eq!(
            bench
                .set_int("in", NULL_INT)
                .set_int("other", 5)
                .step()
                .int("out"),
            5
        );
    }

    #[test]
    fn a_null_composite_is_replaced_whole() {
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Real), 3);
        bench
            .set_reals("in", &[1.0, 2.0, f64::NAN])
            .set_reals("other", &[7.0, 8.0, 9.0]);
        assert_eq!(bench.step().reals("out", 3), [7.0, 8.0, 9.0]);
    }
}
