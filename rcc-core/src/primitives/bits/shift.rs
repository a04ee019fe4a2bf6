//! `Shift`: shifts the bits of an integer to the left or, by a negative number of places, to the right. The shift is
//! arithmetic: left multiplies by powers of 2, right divides and rounds down.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_int};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Shift",
        summary: "Shifts the bits of an integer to the left or, by a negative number of places, to the right.",
        undefined: "overflow: significant bits that would be lost; remove them with `BitAnd` before",
        formula: "out = ⌊in · 2^by⌋",
        examples: &[Example::new(
            "left and right",
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
            Port::int("by", "number of places to the left"),
        ],
        outputs: &[Port::int("out", "result")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_int(frame, operands, shifted);
    })],
);

/// Returns the result and whether it is out of range.
#[inline(always)]
fn shifted(value: i64, by: i64) -> (i64, bool) {
    if by < 0 {
        // A right shift by 63 places leaves only the sign.
        return (value >> by.saturating_neg().min(63), false);
    }
    let left = value << by.min(63);
    // Shifting back must restore the input, otherwise bits were lost.
    (
        left,
        (left >> by.min(63) != value) | ((by > 63) & (value != 0)),
    )
}
