//! `Negate`: out = -in.

use crate::frame::Frame;
use crate::primitive::{
    ByElement, CatalogueEntry, Element, Example, Int, Kernel, Port, Real, Slot, Spec, Step,
    UnitRule, operands,
};

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
        Kernel::scalar::<Negate<Real>>(),
        Kernel::by_element::<Negate<Real>>(),
        Kernel::scalar::<Negate<Int>>(),
        Kernel::by_element::<Negate<Int>>(),
    ],
);

operands! {
    struct Negate<E> { input: Slot<E>, out: Slot<E> }
}

impl Step for Negate<Real> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(self.out, -value)
    }
}

impl Step for Negate<Int> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        // Null (`i64::MIN`) is its own negation.
        frame.put(self.out, value.wrapping_neg())
    }
}

impl<E: Element> ByElement for Negate<E>
where
    Negate<E>: Step,
{
    #[inline(always)]
    fn element(self, i: u32) -> Self {
        Negate {
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
        let mut bench = PrimitiveHarness::wide("Negate", Some(Store::Real), 1);
        for (input, out) in [(1.5, -1.5), (-2.0, 2.0), (f64::MAX, f64::MIN)] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        let mut bench = PrimitiveHarness::wide("Negate", Some(Store::Int), 1);
        for (input, out) in [(3, -3), (-3, 3), (NULL_INT, NULL_INT)] {
            assert_eq!(bench.set_int("in", input).step().int("out"), out);
        }
    }
}
