//! `And`: both are true; null if either is null (strict, as every primitive unless it says otherwise).

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, each_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "And",
        summary: "True while both are true.",
        examples: &[Example::new(
            "both must be true; whoever knows a default for null, puts `OrElse` before",
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
