//! `Not`: out = not in; null if it is null.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Kernel, Port, Slot, Spec, Step, choose, operands,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Not",
        summary: "True while its input is false.",
        examples: &[Example::new(
            "negation",
            "",
            "in | out
                 true | false
                 false | true
                 null | null",
        )],
        inputs: &[Port::bool("in", "operand")],
        outputs: &[Port::bool("out", "not in")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Not>()],
);

operands! {
    struct Not { input: Slot<Bool>, out: Slot<Bool> }
}

impl Step for Not {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(
            self.out,
            choose(value & NULL_BOOL != 0, NULL_BOOL, value ^ 1),
        )
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn truth_table() {
        let mut bench = PrimitiveHarness::new("Not");
        for (input, out) in [
            (Some(false), Some(true)),
            (Some(true), Some(false)),
            (None, None),
        ] {
            assert_eq!(bench.set_bool("in", input).step().bool("out"), out);
        }
    }
}
