//! The limit that makes a motion with a given speed slower than its path requires, and its place. Used when a motion is
//! built.

use rcc_core::path::Quantity;

use super::speed_limits::{SampledPart, quantity};
use crate::path_clock::{PathBounds, duration_s};

/// It is reported if a law is known with which the path takes less than this fraction of its time.
pub(super) const REPORTED: f64 = 1.0 / 1.3;

/// A section from rest to rest that takes much longer than its limits require, because one acceleration and one jerk apply
/// to the whole of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlowSection {
    /// Index of the leg with the place that slows the section down.
    pub leg: u32,
    /// Position on that leg, 0 to 1.
    pub fraction: f64,
    /// The quantity that is at its limit there.
    pub quantity: Quantity,
    /// Order of the limit: 1 velocity, 2 acceleration, 3 jerk.
    pub order: u8,
    /// Duration of the section, s.
    pub takes_s: f64,
    /// Duration with a time law that keeps the same limits, s.
    pub possible_s: f64,
}

/// A place of a section that decides about its clock's limits.
pub(super) struct LimitingPlace {
    /// Index of the part.
    pub(super) part: usize,
    /// Position in the part, 0 to 1.
    pub(super) fraction: f64,
    pub(super) quantity: Quantity,
    /// 1 velocity, 2 acceleration, 3 jerk.
    pub(super) order: u8,
}

/// Factor of a clock limit in the search for the one that costs most time.
const MORE: f64 = 1.5;

/// The place that decides about the limit of the clock of which more would save most time.
pub(super) fn limiting_place(
    parts: &[SampledPart],
    ends: &[f64],
    bounds: &PathBounds,
) -> Option<LimitingPlace> {
    let time = |order: usize| {
        let mut factors = [1.0; 3];
        factors[order] = MORE;
        bounds
            .scaled(factors)
            .map_or(f64::INFINITY, |it| duration_s(&it))
    };
    let costly = (0..3).min_by(|a, b| time(*a).total_cmp(&time(*b)))?;
    let begins = core::iter::once(0.0).chain(ends.iter().copied());
    let speeds = begins
        .zip(ends)
        .map(|(from, to)| bounds.velocity_at(0.5 * (from + to)));
    let speeds: Vec<f64> = speeds.collect();
    let slowest = speeds.iter().copied().fold(f64::INFINITY, f64::min);
    let [acceleration, jerk] = [bounds.acceleration(), bounds.jerk()];
    let mut most = 0.0;
    let mut place = None;
    for (number, (part, speed)) in parts.iter().zip(speeds).enumerate() {
        if costly == 0 && speed > slowest {
            continue;
        }
        for (at, sample) in part.samples.iter().enumerate() {
            for (index, ([first, second, third], [v, a, j])) in
                sample.iter().zip(&part.bounds).enumerate()
            {
                let uses = [
                    first * speed / v,
                    (second * speed * speed + first * acceleration) / a,
                    (third * speed * speed * speed
                        + 3.0 * second * speed * acceleration
                        + first * jerk)
                        / j,
                ];
                for (order, used) in (0..3).zip(uses) {
                    if used > most && (costly == 0 || costly == order) {
                        most = used;
                        place = Some(LimitingPlace {
                            part: number,
                            fraction: at as f64 / (part.samples.len().max(2) - 1) as f64,
                            quantity: quantity(index),
                            order: order as u8 + 1,
                        });
                    }
                }
            }
        }
    }
    place
}
