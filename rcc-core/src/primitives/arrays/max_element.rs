//! `MaxElement`: the largest element of an array.

use crate::primitive::{CatalogueEntry, ELEMENTS, Example, Spec, reduce};
use crate::primitives::arithmetic::max::Max;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MaxElement",
        summary: "The largest element of an array.",
        examples: &[Example::new(
            "an array with a null element",
            "",
            "in | out
             [1.5, 2.0, -4.0] | 2.0
             [1.5, null, -4.0] | null",
        )],
        ..ELEMENTS
    },
    &const { reduce::<Max>() },
);
