//! `CyclePeriod`: the time from one evaluation of the net to the next.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, NullRule, Port, Spec, UnitRule, each};

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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [out]: [u32; 1]) -> Option<()> {
    let period_s = frame.dt_s;
    frame.put_real(out, period_s)
}
