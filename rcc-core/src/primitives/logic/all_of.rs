//! `AllOf`: true if every element of a `Bool` array is true: `And` for any number of operands.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, TRUTHS, fold_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AllOf",
        summary: "True while every element of an array is true.",
        outputs: &[Port::bool("out", "all elements are true")],
        examples: &[Example::new(
            "three Bools",
            "",
            "in | out
             [true, true, true] | true
             [true, false, true] | false
             [true, null, false] | null",
        )],
        ..TRUTHS
    },
    &[Kernel::new(|frame, operands| {
        fold_bool(frame, operands, 1, |a, b| a & b);
    })],
);
