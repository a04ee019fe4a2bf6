//! `Negate`: out = -in.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Negate",
        summary: "The negative of a number, vector, array or matrix.",
        examples: &[
            Example::new(
                "numbers",
                "",
                "in | out
             0.5 | -0.5
             null | null",
            ),
            Example::new(
                "integers",
                "",
                "in | out
             -7 | 7",
            ),
        ],
        inputs: &[Port::linear("in", UnitRule::Var(0), "operand")],
        outputs: &[Port::linear("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &[
        Kernel::single(Store::Real, |frame, operands| {
            each(frame, operands, step_real);
        }),
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, wide_real);
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
    frame.put_real(out, -value)
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_int(input)?;
    // Null (`i64::MIN`) is its own negation.
    frame.put_int(out, value.wrapping_neg())
}

#[inline(always)]
fn wide_real(frame: &mut Frame<'_>, [input, out, width]: [u32; 3]) -> Option<()> {
    (0..width).try_for_each(|i| step_real(frame, [input + i, out + i]))
}

#[inline(always)]
fn wide_int(frame: &mut Frame<'_>, [input, out, width]: [u32; 3]) -> Option<()> {
    (0..width).try_for_each(|i| step_int(frame, [input + i, out + i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;
    use crate::types::NULL_INT;

    #[test]
    fn worked_values_and_null() {
        let mut bench = PrimitiveHarness::wide("Negate", Some(Store::Real), 1);
        for (input, out) in [(1.5, -1.5), (-2.0, 2.0), (f64::INFINITY, f64::NEG_INFINITY)] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        let mut bench = PrimitiveHarness::wide("Negate", Some(Store::Int), 1);
        for (input, out) in [(3, -3), (-3, 3), (NULL_INT, NULL_INT)] {
            assert_eq!(bench.set_int("in", input).step().int("out"), out);
        }
    }
}
