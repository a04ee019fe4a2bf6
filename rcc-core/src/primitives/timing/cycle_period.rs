//! `CyclePeriod`: the time from one evaluation of the net to the next.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, NullRule, Port, Real, Slot, Spec, Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "CyclePeriod",
        summary: "The period at which the net is evaluated.",
        null: "never null",
        null_rule: NullRule::Known,
        examples: &[
            Example::new("every cycle of 1 ms", "", "out\n 1 ms\n 1 ms"),
            Example::new("a slower net", "", "out\n 5 ms").every_ms(5),
        ],
        outputs: &[Port::real(
            "out",
            UnitRule::SECOND,
            "logical time between two evaluations",
        )
        .within(0.0, 1.0)],
        ..Spec::PLAIN
    },
    &[Kernel::each::<CyclePeriod>()],
);

operands! {
    struct CyclePeriod { out: Slot<Real> }
}

impl Step for CyclePeriod {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let period_s = frame.dt_s;
        frame.put(self.out, period_s)
    }
}
