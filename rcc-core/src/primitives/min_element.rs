//! `MinElement`: the smallest element of an array.

use crate::primitive::{CatalogueEntry, ELEMENTS, Example, Kernel, Spec, fold_int, fold_real};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MinElement",
        summary: "The smallest element of an array.",
        examples: &[Example::new(
            "an array with a null element",
            "",
            "in | out
             [1.5, 2.0, -4.0] | -4.0
             [1.5, null, -4.0] | null",
        )],
        ..ELEMENTS
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            fold_real(
                frame,
                operands,
                |a, b| if a.is_nan() | (a < b) { a } else { b },
            );
        }),
        Kernel::of(Store::Int, |frame, operands| {
            fold_int(frame, operands, |a, b| (a.min(b), false));
        }),
    ],
);
