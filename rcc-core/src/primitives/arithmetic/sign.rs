//! `Sign`: -1, 0 or 1.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, Step, UnitRule, choose, operands,
    real_unless,
};
use crate::types::NULL_INT;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Sign",
        summary: "The sign of a number: -1, 0 or 1.",
        examples: &[
            Example::new(
                "real numbers",
                "",
                "in | out
                 2.5 | 1.0
                 -0.1 | -1.0
                 0.0 | 0.0
                 null | null",
            ),
            Example::new(
                "integers",
                "",
                "in | out
                 7 | 1
                 -7 | -1
                 0 | 0
                 null | null",
            )
            .whole(),
        ],
        inputs: &[Port::number("in", UnitRule::Var(0), "number")],
        outputs: &[Port::number("out", UnitRule::ONE, "its sign").within(-1.0, 1.0)],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Sign<Real>>(), Kernel::each::<Sign<Int>>()],
);

operands! {
    struct Sign<E> { input: Slot<E>, out: Slot<E> }
}

impl Step for Sign<Real> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(
            self.out,
            real_unless(
                value.is_nan(),
                f64::from(i8::from(value > 0.0) - i8::from(value < 0.0)),
            ),
        )
    }
}

impl Step for Sign<Int> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(
            self.out,
            choose(value == NULL_INT, NULL_INT, value.signum()),
        )
    }
}
