//! Arrays and matrices: arrays and matrices of numbers.

use super::CatalogueEntry;

mod at;
mod concatenate;
mod determinant;
mod dot;
mod inverse;
mod matrix_apply;
mod matrix_multiply;
mod max_element;
mod min_element;
mod norm;
mod set_element;
mod solve;
mod sum;
mod transpose;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &at::ENTRY,
    &concatenate::ENTRY,
    &determinant::ENTRY,
    &dot::ENTRY,
    &inverse::ENTRY,
    &matrix_apply::ENTRY,
    &matrix_multiply::ENTRY,
    &max_element::ENTRY,
    &min_element::ENTRY,
    &norm::ENTRY,
    &set_element::ENTRY,
    &solve::ENTRY,
    &sum::ENTRY,
    &transpose::ENTRY,
];
