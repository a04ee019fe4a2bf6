//! Selection and null: values of any type.

use super::CatalogueEntry;

pub(super) mod copy;
mod hold;
mod is_null;
mod last_known;
mod multiplexer;
mod null_if;
mod or_else;
mod select;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &copy::ENTRY,
    &hold::ENTRY,
    &is_null::ENTRY,
    &last_known::ENTRY,
    &multiplexer::ENTRY,
    &null_if::ENTRY,
    &or_else::ENTRY,
    &select::ENTRY,
];
