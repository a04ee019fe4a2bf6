//! `BitNot`: bitwise complement of an integer, in two's complement.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Int, Kernel, Port, Slot, Spec, Step, choose, operands,
};
use crate::types::NULL_INT;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "BitNot",
        summary: "An integer with every bit inverted; use `BitAnd` to keep the relevant bits.",
        undefined: "overflow: 2^63 - 1 (-2^63 stands for null)",
        formula: "out = -1 - in",
        examples: &[Example::new(
            "the complement of no bits is all bits",
            "",
            "in | out
             0 | -1
             5 | -6
             -1 | 0
             null | null",
        )],
        inputs: &[Port::int("in", "operand")],
        outputs: &[Port::int("out", "!in, of 64 bits in two's complement")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<BitNot>()],
);

operands! {
    struct BitNot { input: Slot<Int>, out: Slot<Int> }
}

impl Step for BitNot {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(self.out, choose(value == NULL_INT, NULL_INT, !value))
    }
}
