//! Curves and tables: interpolation between values.

use super::CatalogueEntry;

mod cubic_bezier;
mod cubic_hermite;
mod interpolate;
mod lerp;
mod lookup;
mod lookup2;
mod trapezoidal_progress;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &cubic_bezier::ENTRY,
    &cubic_hermite::ENTRY,
    &interpolate::ENTRY,
    &lerp::ENTRY,
    &lookup::ENTRY,
    &lookup2::ENTRY,
    &trapezoidal_progress::ENTRY,
];
