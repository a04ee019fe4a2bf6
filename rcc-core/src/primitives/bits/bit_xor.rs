//! `BitXor`: bitwise XOR of two integers, in two's complement.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_int};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "BitXor",
        summary: "The bits in which two integers differ (bitwise XOR).",
        undefined: "overflow: numbers that differ only in the sign bit (-2^63 stands for null)",
        examples: &[Example::new(
            "1100 and 1010 differ in two bits",
            "",
            "a | b | out
             12 | 10 | 6
             5 | 5 | 0
             -1 | 5 | -6
             null | 5 | null",
        )],
        inputs: &[
            Port::int("a", "first operand"),
            Port::int("b", "second operand"),
        ],
        outputs: &[Port::int("out", "a ^ b, of 64 bits in two's complement")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_int(frame, operands, |a, b| (a ^ b, false));
    })],
);
