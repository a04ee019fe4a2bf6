//! Nets: the inputs, outputs and end of a net.

use super::CatalogueEntry;

mod cancel;
mod constant;
mod input;
mod monitor;
mod publish;
mod subscribe;
mod termination;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &cancel::ENTRY,
    &constant::ENTRY,
    &input::ENTRY,
    &monitor::ENTRY,
    &publish::ENTRY,
    &subscribe::ENTRY,
    &termination::ENTRY,
];
