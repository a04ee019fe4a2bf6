//! `BitAnd`: bitwise AND of two integers, in two's complement.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_int};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "BitAnd",
        summary: "The bits that are set in both of two integers (bitwise AND).",
        undefined: "overflow: negative numbers that share no bit but the sign (-2^63 stands for null)",
        examples: &[Example::new(
            "1100 and 1010; -1 has all bits set",
            "",
            "a | b | out
                 12 | 10 | 8
                 -1 | 5 | 5
                 null | 5 | null",
        )],
        inputs: &[
            Port::int("a", "first operand"),
            Port::int("b", "second operand, for instance a mask"),
        ],
        outputs: &[Port::int("out", "a & b, of 64 bits in two's complement")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_int(frame, operands, |a, b| (a & b, false));
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::check_int;

    #[test]
    fn worked_values_and_null() {
        check_int(
            "BitAnd",
            &[[0b1100, 0b1010, 0b1000], [-1, 255, 255], [-2, -3, -4]],
        );
    }
}
