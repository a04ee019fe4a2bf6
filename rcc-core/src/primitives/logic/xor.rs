//! `Xor`: true if exactly one is true; null if either is null.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Xor",
        summary: "True while exactly one input is true.",
        examples: &[Example::new(
            "one or the other, but not both",
            "",
            "a | b | out
                 true | false | true
                 true | true | false
                 false | false | false
                 null | true | null",
        )],
        inputs: &[
            Port::bool("a", "first operand"),
            Port::bool("b", "second operand"),
        ],
        outputs: &[Port::bool("out", "a is not b")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_bool(frame, operands, |a, b| a ^ b);
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::check_truth_table;

    #[test]
    fn truth_table() {
        let (no, yes, null) = (Some(false), Some(true), None);
        check_truth_table(
            "Xor",
            [[no, yes, null], [yes, no, null], [null, null, null]],
        );
    }
}
