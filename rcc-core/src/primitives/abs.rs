//! `Abs`: out = |in|.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Abs",
        summary: "The absolute value of a number, or of each element of a vector, array or matrix.",
        examples: &[
            Example::new(
                "numbers",
                "",
                "in | out
             -2.5 | 2.5
             3.0 | 3
             null | null",
            ),
            Example::new(
                "integers",
                "",
                "in | out
             -7 | 7
             0 | 0",
            ),
            Example::new(
                "each element of an array",
                "",
                "in | out
             [-1.5, 2.0, -0.5] | [1.5, 2.0, 0.5]",
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
    frame.put_real(out, value.abs())
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_int(input)?;
    // Null (`i64::MIN`) is its own negation.
    frame.put_int(out, value.wrapping_abs())
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
        let mut bench = PrimitiveHarness::wide("Abs", Some(Store::Real), 1);
        for (input, out) in [(1.5, 1.5), (-1.5, 1.5), (f64::NEG_INFINITY, f64::INFINITY)] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        let mut bench = PrimitiveHarness::wide("Abs", Some(Store::Int), 1);
        for (input, out) in [(3, 3), (-3, 3), (-i64::MAX, i64::MAX), (NULL_INT, NULL_INT)] {
            assert_eq!(bench.set_int("in", input).step().int("out"), out);
        }
    }
}
