//! `Shift`: the bits of a whole number moved to the left, or, by a negative number of places, to the right. It is
//! arithmetic: to the left multiplies by powers of 2, to the right divides and rounds down.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_int};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Shift",
        summary: "The bits of an integer moved to the left; by a negative number of places, to the right.",
        undefined: "overflow: bits that would be lost; `BitAnd` takes them off before",
        formula: "out = ⌊in · 2^by⌋",
        examples: &[Example::new(
            "to the left and to the right",
            "",
            "in | by | out
             5 | 2 | 20
             -5 | 1 | -10
             20 | -2 | 5
             -1 | -70 | -1
             7 | -70 | 0
             0 | 70 | 0
             1 | 62 | 4611686018427387904
             1 | 63 | null
             1 | 70 | null
             null | 1 | null
             1 | null | null",
        )],
        inputs: &[
            Port::int("in", "operand"),
            Port::int("by", "places to the left"),
        ],
        outputs: &[Port::int("out", "result")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_int(frame, operands, shifted);
    })],
);

/// The result, and whether it is out of range.
#[inline(always)]
fn shifted(value: i64, by: i64) -> (i64, bool) {
    if by < 0 {
        // 63 places leave nothing but the sign.
        return (value >> by.saturating_neg().min(63), false);
    }
    let left = value << by.min(63);
    // What was lost does not come back.
    (
        left,
        (left >> by.min(63) != value) | ((by > 63) & (value != 0)),
    )
}
