//! `FirstCycle`: true in the first cycle of the net, for actions that must run once.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Kernel, NullRule, Port, Slot, Spec, Step, operands,
};

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
    &[Kernel::each::<FirstCycle>()],
);

operands! {
    struct FirstCycle { out: Slot<Bool> }
}

impl Step for FirstCycle {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let is_first = u8::from(frame.cycle == 0);
        frame.put(self.out, is_first)
    }
}
