//! `SquareRoot`: correctly rounded; a negative number gives null.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SquareRoot",
        summary: "The square root of a number; its unit is the square root of the number's unit.",
        null: "a null input gives null, and so does a negative one",
        undefined: "in < 0",
        examples: &[Example::new(
            "a root, and a negative number",
            "",
            "in | out
                 4 | 2
                 0 | 0
                 2 | 1.4142135623730951
                 -1 | null
                 null | null",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "operand, at least 0")],
        outputs: &[Port::real("out", UnitRule::Root(0), "result")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<SquareRoot>()],
);

operands! {
    struct SquareRoot { input: Slot<Real>, out: Slot<Real> }
}

impl Step for SquareRoot {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        // NaN for a negative number (IEEE 754-2019, 5.4.1).
        let root = libm::sqrt(frame.get(self.input)?);
        frame.put(self.out, root)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn worked_values_and_null() {
        let mut bench = PrimitiveHarness::new("SquareRoot");
        for (input, out) in [
            (4.0, 2.0),
            (2.0, core::f64::consts::SQRT_2),
            (0.0, 0.0),
            (-0.0, 0.0),
        ] {
            assert_eq!(bench.set_real("in", input).step().real("out"), out);
        }
        for input in [f64::NAN, -1.0, f64::MIN] {
            assert!(bench.set_real("in", input).step().real("out").is_nan());
        }
    }
}
