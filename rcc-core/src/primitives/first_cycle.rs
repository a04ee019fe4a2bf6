//! `FirstCycle`: true in the first cycle of the net, for actions that must run once.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, NullRule, Port, Spec, each};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "FirstCycle",
        summary: "True in the first cycle after START, false afterwards.",
        null: "never null",
        null_rule: NullRule::Known,
        examples: &[Example::new(
            "three cycles",
            "",
            "out\n true\n false\n false",
        )],
        outputs: &[Port::bool("out", "true in the first cycle")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [out]: [u32; 1]) -> Option<()> {
    let is_first = u8::from(frame.cycle == 0);
    frame.put_bool(out, is_first)
}
