//! `IntDivide`: integer division, rounded towards zero.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_int};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "IntDivide",
        summary: "The quotient of two integers, rounded towards zero.",
        undefined: "b = 0",
        formula: "out = truncate(a / b): a = b · out + Remainder(a, b)",
        examples: &[Example::new(
            "positive, negative, and by zero",
            "",
            "a | b | out
             7 | 2 | 3
             -7 | 2 | -3
             7 | -2 | -3
             7 | 0 | null
             null | 1 | null",
        )],
        inputs: &[Port::int("a", "dividend"), Port::int("b", "divisor")],
        outputs: &[Port::int("out", "quotient")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_int(frame, operands, |a, b| {
            let quotient = a.checked_div(b);
            (quotient.unwrap_or(0), quotient.is_none())
        });
    })],
);
