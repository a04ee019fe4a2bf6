//! `Sum`: the sum of the elements of an array, from the first to the last, with each step rounded once.

use crate::primitive::{CatalogueEntry, ELEMENTS, Example, Spec, reduce};
use crate::primitives::arithmetic::add::Add;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Sum",
        summary: "The sum of the elements of an array.",
        undefined: "overflow",
        examples: &[Example::new(
            "an array with a null element",
            "",
            "in | out
             [1.5, 2.0, -4.0] | -0.5
             [1.5, null, -4.0] | null",
        )],
        ..ELEMENTS
    },
    &const { reduce::<Add>() },
);
