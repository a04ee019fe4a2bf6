//! `BitOr`: bitwise OR of two integers, in two's complement.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_int};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "BitOr",
        summary: "The bits that are set in at least one of two integers (bitwise OR).",
        examples: &[Example::new(
            "1100 or 1010; -1 has all bits set",
            "",
            "a | b | out
             12 | 10 | 14
             -1 | 5 | -1
             null | 5 | null",
        )],
        inputs: &[
            Port::int("a", "first operand"),
            Port::int("b", "second operand"),
        ],
        outputs: &[Port::int("out", "a | b, of 64 bits in two's complement")],
        ..Spec::PLAIN
    },
    // The sign bit alone is the null value: it results from two numbers only if one of them is null.
    &[Kernel::new(|frame, operands| {
        each_int(frame, operands, |a, b| (a | b, false));
    })],
);
