//! `AnyOf`: true if any element of a `Bool` array is true: `Or` for any number of operands.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, TRUTHS, fold_bool};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AnyOf",
        summary: "True while at least one element of an array is true.",
        outputs: &[Port::bool("out", "at least one element is true")],
        examples: &[Example::new(
            "three Bools",
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
