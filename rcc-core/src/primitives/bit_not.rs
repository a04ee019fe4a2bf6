//! `BitNot`: bitwise complement of an integer, in two's complement.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, choose, each};
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let value = frame.get_int(input)?;
    frame.put_int(out, choose(value == NULL_INT, NULL_INT, !value))
}
