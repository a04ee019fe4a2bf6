//! Arithmetic: numbers.

use super::CatalogueEntry;

mod abs;
pub(super) mod add;
mod arc_cosine;
mod arc_sine;
mod arc_tangent;
mod ceiling;
mod cosine;
mod divide;
mod exponential;
mod floor;
mod hypotenuse;
mod int_divide;
mod limit;
mod logarithm;
pub(super) mod max;
mod median;
pub(super) mod min;
pub(super) mod multiply;
mod negate;
mod power;
mod quantize;
mod remainder;
mod round;
mod scale;
mod sign;
mod sine;
mod square_root;
mod subtract;
mod tangent;
mod to_real;
mod truncate;
mod wrap;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &abs::ENTRY,
    &add::ENTRY,
    &arc_cosine::ENTRY,
    &arc_sine::ENTRY,
    &arc_tangent::ENTRY,
    &ceiling::ENTRY,
    &cosine::ENTRY,
    &divide::ENTRY,
    &exponential::ENTRY,
    &floor::ENTRY,
    &hypotenuse::ENTRY,
    &int_divide::ENTRY,
    &limit::ENTRY,
    &logarithm::ENTRY,
    &max::ENTRY,
    &median::ENTRY,
    &min::ENTRY,
    &multiply::ENTRY,
    &negate::ENTRY,
    &power::ENTRY,
    &quantize::ENTRY,
    &remainder::ENTRY,
    &round::ENTRY,
    &scale::ENTRY,
    &sign::ENTRY,
    &sine::ENTRY,
    &square_root::ENTRY,
    &subtract::ENTRY,
    &tangent::ENTRY,
    &to_real::ENTRY,
    &truncate::ENTRY,
    &wrap::ENTRY,
];
