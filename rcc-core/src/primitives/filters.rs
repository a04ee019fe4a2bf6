//! Filters and control: filters, windows, controllers and generators.

use super::CatalogueEntry;

mod backlash;
mod biquad;
mod dead_band;
mod delay;
mod derivative;
mod first_order_low_pass;
mod high_pass;
mod integrator;
mod low_pass;
mod mean;
mod noise;
mod notch;
mod peak_hold;
mod pid;
mod rate_limit;
mod second_order_low_pass;
mod signal_generator;
mod tare;
mod unwrap;
mod window_max;
mod window_mean;
mod window_min;
mod window_rms;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &backlash::ENTRY,
    &biquad::ENTRY,
    &dead_band::ENTRY,
    &delay::ENTRY,
    &derivative::ENTRY,
    &first_order_low_pass::ENTRY,
    &high_pass::ENTRY,
    &integrator::ENTRY,
    &low_pass::ENTRY,
    &mean::ENTRY,
    &noise::ENTRY,
    &notch::ENTRY,
    &peak_hold::ENTRY,
    &pid::ENTRY,
    &rate_limit::ENTRY,
    &second_order_low_pass::ENTRY,
    &signal_generator::ENTRY,
    &tare::ENTRY,
    &unwrap::ENTRY,
    &window_max::ENTRY,
    &window_mean::ENTRY,
    &window_min::ENTRY,
    &window_rms::ENTRY,
];
