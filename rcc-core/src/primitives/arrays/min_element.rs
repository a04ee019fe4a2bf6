//! `MinElement`: the smallest element of an array.

use crate::primitive::{CatalogueEntry, ELEMENTS, Example, Spec, reduce};
use crate::primitives::arithmetic::min::Min;

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
    &const { reduce::<Min>() },
);
