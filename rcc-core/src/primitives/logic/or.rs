//! `Or`: true if at least one is true; null if either is null (strict, as all primitives unless stated otherwise).

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Or",
        summary: "True while at least one input is true.",
        examples: &[Example::new(
            "one is sufficient; to treat null as a known value, put `OrElse` before",
            "",
            "a | b | out
                 false | false | false
                 true | false | true
                 null | true | null
                 null | false | null",
        )],
        inputs: &[
            Port::bool("a", "first operand"),
            Port::bool("b", "second operand"),
        ],
        outputs: &[Port::bool("out", "a or b")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_bool(frame, operands, |a, b| a | b);
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::check_truth_table;

    #[test]
    fn truth_table() {
        let (no, yes, null) = (Some(false), Some(true), None);
        check_truth_table(
            "Or",
            [[no, yes, null], [yes, yes, null], [null, null, null]],
        );
    }
}
