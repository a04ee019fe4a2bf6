//! Bits: Ints as bits.

use super::CatalogueEntry;

mod bit_and;
mod bit_not;
mod bit_or;
mod bit_xor;
mod from_bits;
mod shift;
mod to_bits;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &bit_and::ENTRY,
    &bit_not::ENTRY,
    &bit_or::ENTRY,
    &bit_xor::ENTRY,
    &from_bits::ENTRY,
    &shift::ENTRY,
    &to_bits::ENTRY,
];
