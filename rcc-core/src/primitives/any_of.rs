//! `AnyOf`: whether a truth value of an array is true: Or for any number of them.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, TRUTHS, fold_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AnyOf",
        summary: "True while an element of an array is true.",
        outputs: &[Port::bool("out", "one is true")],
        examples: &[Example::new(
            "three truth values",
            "",
            "in | out
             [false, false, false] | false
             [true, false, true] | true
             [true, null, false] | null",
        )],
        ..TRUTHS
    },
    &[Kernel::new(|frame, operands| {
        fold_bool(frame, operands, 0, |a, b| a | b);
    })],
);
