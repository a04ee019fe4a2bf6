//! `And`: true if both are true; null if either is null (strict, as all primitives unless stated otherwise).

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "And",
        summary: "True while both inputs are true.",
        examples: &[Example::new(
            "both must be true; to treat null as a known value, put `OrElse` before",
            "",
            "a | b | out
                 true | true | true
                 true | false | false
                 null | false | null
                 null | true | null",
        )],
        inputs: &[
            Port::bool("a", "first operand"),
            Port::bool("b", "second operand"),
        ],
        outputs: &[Port::bool("out", "a and b")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_bool(frame, operands, |a, b| a & b);
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::check_truth_table;

    #[test]
    fn truth_table() {
        let (no, yes, null) = (Some(false), Some(true), None);
        check_truth_table("And", [[no, no, null], [no, yes, null], [null, null, null]]);
    }
}
