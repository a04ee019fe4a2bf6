//! Logic: Bools, comparisons, memories of events.

use super::CatalogueEntry;

mod all_of;
mod and;
mod any_of;
mod equals;
mod falling_edge;
mod greater;
mod hysteresis;
mod latch;
mod less;
mod majority;
mod not;
mod or;
mod rising_edge;
mod state_machine;
mod toggle;
mod trigger;
mod xor;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &all_of::ENTRY,
    &and::ENTRY,
    &any_of::ENTRY,
    &equals::ENTRY,
    &falling_edge::ENTRY,
    &greater::ENTRY,
    &hysteresis::ENTRY,
    &latch::ENTRY,
    &less::ENTRY,
    &majority::ENTRY,
    &not::ENTRY,
    &or::ENTRY,
    &rising_edge::ENTRY,
    &state_machine::ENTRY,
    &toggle::ENTRY,
    &trigger::ENTRY,
    &xor::ENTRY,
];
