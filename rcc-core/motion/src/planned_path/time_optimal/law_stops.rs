//! Stops from a time law that is followed at full speed: the hardest ones that keep every limit, checked one by one. Used when a
//! motion is built; allocates.

use core::ops::Range;

use rcc_core::axis::AxisState;

use super::super::sampled_path::SampledPath;
use super::super::speed_limits::{BrakingLimits, DerivativeSample};
use super::super::time_law::TimeLaw;
use super::close_samples::{at_time, curve_bounds};
use crate::geometry::jet::Jet;
use crate::jerk_profile::AccelerationLimits;
use crate::path_clock::{PathBounds, PathPiece};

/// Cycles from one time at which a stop may begin to the next, and most times.
const EVERY_CYCLES: f64 = 8.0;
const STOPS_MAX: f64 = 1000.0;

/// Fractions of the greatest acceleration and jerk along the path that are tried.
const ACCELERATIONS: [f64; 6] = [1.0, 0.85, 0.7, 0.5, 0.3, 0.15];
const JERKS: [f64; 4] = [0.9, 0.6, 0.35, 0.15];

/// Samples of each phase of a stop.
const SAMPLES: usize = 12;

/// A stop begins only at these positions of a law; it is recognised by this fraction of the section's length.
const TOLERANCE: f64 = 1e-9;

/// For each of up to [`STOPS_MAX`] cycles of a law that is followed from its beginning: limits for a stop that begins
/// there, if there are any.
pub(super) fn law_stops(
    path: &SampledPath<'_>,
    range: Range<usize>,
    law: &TimeLaw,
) -> Box<[BrakingLimits]> {
    let cycles = (law.duration() / path.dt_s).floor();
    let every = (cycles / STOPS_MAX).ceil().max(EVERY_CYCLES);
    let begin_s = law.position(0.0);
    let length = law.position(law.duration()) - begin_s;
    let count = (cycles / every) as usize;
    let times = (1..=count).map(|number| number as f64 * every * path.dt_s);
    let stops = times.filter_map(|time| {
        let Jet([s, velocity, acceleration, _]) = law.at(Jet::variable(time));
        let state = AxisState {
            position: s,
            velocity,
            acceleration,
        };
        let limits = hardest_stop(path, &range, state, begin_s + length)?;
        let piece = PathPiece {
            end_s: length,
            // A stop is never faster than its state, except while an acceleration is reduced.
            velocity: velocity + acceleration * acceleration / (2.0 * limits.jerk),
        };
        let bounds = PathBounds::new(&[piece], limits.acceleration, limits.jerk, path.dt_s).ok()?;
        Some(BrakingLimits::at(s - begin_s, TOLERANCE * length, bounds))
    });
    stops.collect()
}

/// The limits with which a stop from a state keeps every limit of the path, the hardest first; `None` if it cannot stop
/// before `end_s`.
fn hardest_stop(
    path: &SampledPath<'_>,
    range: &Range<usize>,
    state: AxisState,
    end_s: f64,
) -> Option<AccelerationLimits> {
    let here = number_at(path, range, state.position)?;
    let limited = path.pieces.get(here)?;
    let sample = at_time(
        limited,
        place(path, here, state.position)?,
        Jet([state.position, 1.0, 0.0, 0.0]),
    );
    let mut greatest = [f64::INFINITY; 2];
    for ([first, ..], limits) in sample.iter().zip(&limited.bounds) {
        for (greatest, limit) in greatest.iter_mut().zip(&limits[1..]) {
            *greatest = greatest.min(limit / first);
        }
    }
    let trials = ACCELERATIONS.iter().flat_map(|acceleration| {
        JERKS.iter().map(move |jerk| AccelerationLimits {
            acceleration: acceleration * greatest[0],
            jerk: jerk * greatest[1],
        })
    });
    let mut best: Option<(f64, AccelerationLimits)> = None;
    for limits in trials {
        let stop = limits.stop(state);
        let sooner = best.is_none_or(|(least_s, _)| stop.duration_s() < least_s);
        if sooner && stop.end(state).position <= end_s && keeps_limits(path, range, state, limits) {
            best = Some((stop.duration_s(), limits));
        }
    }
    best.map(|(_, limits)| limits)
}

/// Returns true if a stop keeps every limit of the path.
fn keeps_limits(
    path: &SampledPath<'_>,
    range: &Range<usize>,
    state: AxisState,
    limits: AccelerationLimits,
) -> bool {
    let mut start = state;
    let mut samples: Vec<DerivativeSample> = Vec::with_capacity(SAMPLES + 1);
    for (duration_s, jerk) in limits.stop(state).steps() {
        let mut from_s = 0.0;
        // A phase may lead over several pieces: each part of it is checked with the limits of its piece.
        while from_s < duration_s {
            let Some(number) = number_at(path, range, start.after(from_s, jerk).position) else {
                return false;
            };
            let (Some(sampled), Some(piece)) =
                (path.pieces.get(number), path.chain.pieces().get(number))
            else {
                return false;
            };
            let mut until_s = duration_s;
            if start.after(until_s, jerk).position > piece.end {
                let (mut low, mut high) = (from_s, until_s);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    let inside = start.after(middle, jerk).position <= piece.end;
                    *(if inside { &mut low } else { &mut high }) = middle;
                }
                until_s = high;
            }
            samples.clear();
            for sample in 0..=SAMPLES {
                let t_s = from_s + (until_s - from_s) * sample as f64 / SAMPLES as f64;
                let AxisState {
                    position,
                    velocity,
                    acceleration,
                } = start.after(t_s, jerk);
                if velocity < -1e-9 {
                    return false;
                }
                let Some(place) = place(path, number, position) else {
                    return false;
                };
                samples.push(at_time(
                    sampled,
                    place,
                    Jet([position, velocity, acceleration, jerk]),
                ));
            }
            let bounds = curve_bounds(&samples);
            let rows = bounds.iter().flatten().zip(sampled.bounds.iter().flatten());
            // A comparison with NaN is false.
            if !rows.into_iter().all(|(value, limit)| value <= limit) {
                return false;
            }
            if until_s <= from_s {
                return false;
            }
            from_s = until_s;
        }
        start = start.after(duration_s, jerk);
    }
    true
}

/// The piece with a length that contains a position, the later one at a boundary.
fn number_at(path: &SampledPath<'_>, range: &Range<usize>, s: f64) -> Option<usize> {
    let numbers = range.clone().filter(|number| path.has_length(*number));
    let begun = |number: &usize| {
        path.chain
            .pieces()
            .get(*number)
            .is_some_and(|piece| piece.begin <= s)
    };
    numbers.take_while(begun).last()
}

/// A position in steps of the samples of a piece.
fn place(path: &SampledPath<'_>, number: usize, s: f64) -> Option<f64> {
    let (piece, sampled) = (path.chain.pieces().get(number)?, path.pieces.get(number)?);
    let steps = sampled.samples.points.len().checked_sub(1)? as f64;
    Some(((s - piece.begin) / piece.length() * steps).clamp(0.0, steps))
}
