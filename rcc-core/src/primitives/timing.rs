//! Timing: time, delays, pulses and counters.

use super::CatalogueEntry;

mod blink;
mod counter;
mod cycle_period;
mod debounce;
mod first_cycle;
mod interval;
mod off_delay;
mod on_delay;
mod pulse;
mod time;
mod true_in_window;
mod up_down_counter;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &blink::ENTRY,
    &counter::ENTRY,
    &cycle_period::ENTRY,
    &debounce::ENTRY,
    &first_cycle::ENTRY,
    &interval::ENTRY,
    &off_delay::ENTRY,
    &on_delay::ENTRY,
    &pulse::ENTRY,
    &time::ENTRY,
    &true_in_window::ENTRY,
    &up_down_counter::ENTRY,
];
