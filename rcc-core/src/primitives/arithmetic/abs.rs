//! `Abs`: out = |in|.

use crate::frame::Frame;
use crate::primitive::{
    ByElement, CatalogueEntry, Element, Example, Int, Kernel, Port, Real, Slot, Spec, Step,
    UnitRule, operands,
};

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
        Kernel::scalar::<Abs<Real>>(),
        Kernel::by_element::<Abs<Real>>(),
        Kernel::scalar::<Abs<Int>>(),
        Kernel::by_element::<Abs<Int>>(),
    ],
);

operands! {
    struct Abs<E> { input: Slot<E>, out: Slot<E> }
}

impl Step for Abs<Real> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(self.out, value.abs())
    }
}

impl Step for Abs<Int> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        // Null (`i64::MIN`) is its own negation.
        frame.put(self.out, value.wrapping_abs())
    }
}

impl<E: Element> ByElement for Abs<E>
where
    Abs<E>: Step,
{
    #[inline(always)]
    fn element(self, i: u32) -> Self {
        Abs {
            input: self.input + i,
            out: self.out + i,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::NULL_INT;
    use crate::types::Store;

    #[test]
    fn worked_values_and_null() {
        let mut bench = PrimitiveHarness::wide("Abs", Some(Store::Real), 1);
        for (input, out) in [(1.5, 1.5), (-1.5, 1.5), (f64::MIN, f64::MAX)] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        let mut bench = PrimitiveHarness::wide("Abs", Some(Store::Int), 1);
        for (input, out) in [(3, 3), (-3, 3), (-i64::MAX, i64::MAX), (NULL_INT, NULL_INT)] {
            assert_eq!(bench.set_int("in", input).step().int("out"), out);
        }
    }
}
