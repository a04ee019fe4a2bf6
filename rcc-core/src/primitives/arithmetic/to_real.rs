//! `ToReal`: an integer as a Real; beyond ±2^53 the nearest one, ties to even.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, Step, UnitRule, operands,
    real_unless,
};
use crate::types::NULL_INT;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ToReal",
        summary: "An integer as a Real.",
        examples: &[Example::new(
            "the same number",
            "",
            "in | out
                 7 | 7.0
                 -3 | -3.0
                 null | null",
        )],
        inputs: &[Port::int("in", "integer")],
        outputs: &[Port::real(
            "out",
            UnitRule::Var(0),
            "the same number, in the unit of the reader",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<ToReal>()],
);

operands! {
    struct ToReal { input: Slot<Int>, out: Slot<Real> }
}

impl Step for ToReal {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(self.out, real_unless(value == NULL_INT, value as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn worked_values_and_null() {
        let mut bench = PrimitiveHarness::new("ToReal");
        for (input, out) in [
            (0, 0.0),
            (-7, -7.0),
            ((1 << 53) + 1, 9_007_199_254_740_992.0),
        ] {
            assert_eq!(bench.set_int("in", input).step().real("out"), out);
        }
        assert!(bench.set_int("in", NULL_INT).step().real("out").is_nan());
    }
}
