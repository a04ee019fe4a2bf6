//! Samples of a time law, as close as those of its path: the values that its limits are checked with. Used when a motion is
//! built; allocates.

use core::ops::Range;

use super::super::sampled_path::{SampledPath, SampledPiece};
use super::super::speed_limits::{DerivativeSample, MARGIN, QUANTITIES};
use super::super::time_law::TimeLaw;
use super::limited_values::ClockReserve;
use crate::geometry::chain::ChainPiece;
use crate::geometry::jet::{Jet, JetScalar};

/// Number of parts in which a curve of a time law is sampled: least and greatest.
const PARTS: f64 = 4.0;
const PARTS_MAX: f64 = 512.0;

/// Calls `each` with the bounds of velocity, acceleration and jerk of every limited quantity on every curve of a law
/// within every piece, including what its clock may add, and with its limits.
pub(super) fn each_bound(
    path: &SampledPath<'_>,
    range: Range<usize>,
    (law, reserve): (&TimeLaw, ClockReserve),
    mut each: impl FnMut([f64; 3], [f64; 3]),
) {
    let (step_s, count) = law.curves();
    let mut samples = Vec::new();
    for (piece, sampled) in path.with_length(range) {
        let span = [piece.begin, piece.end].map(|s| law.inverse(s) / step_s);
        for curve in span[0] as usize..(span[1].ceil() as usize).min(count) {
            let part = span.map(|place| (place - curve as f64).clamp(0.0, 1.0) * step_s);
            samples.clear();
            on_curve(law, curve, part, (piece, sampled), &mut samples);
            for [first, second, third] in samples.iter_mut().flatten() {
                let ClockReserve { acceleration, jerk } = reserve;
                *third += 3.0 * acceleration * *second + jerk * *first;
                *second += acceleration * *first;
            }
            let bounds = curve_bounds(&samples);
            for (values, limits) in bounds.iter().zip(&sampled.bounds) {
                if limits.iter().any(|limit| limit.is_finite()) {
                    each(*values, *limits);
                }
            }
        }
    }
}

/// Derivatives by time on a part of one curve of a law, from one time to another after its beginning: as densely as the
/// piece was sampled.
fn on_curve(
    law: &TimeLaw,
    curve: usize,
    [from, to]: [f64; 2],
    (piece, sampled): (&ChainPiece, &SampledPiece),
    samples: &mut Vec<DerivativeSample>,
) {
    let steps = sampled.samples.points.len().saturating_sub(1).max(1) as f64;
    let close = piece.length() / steps;
    let ways = [from, to].map(|time| law.on_curve(curve, time).map_or(0.0, JetScalar::value));
    let parts = ((ways[1] - ways[0]) / close).ceil().clamp(PARTS, PARTS_MAX);
    for part in 0..=parts as usize {
        let time = from + (to - from) * part as f64 / parts;
        let Some(s) = law.on_curve(curve, time) else {
            continue;
        };
        let place = ((s.value() - piece.begin) / close).clamp(0.0, steps);
        samples.push(at_time(sampled, place, s));
    }
}

/// Bounds of values that are smooth between these equidistant samples: the greatest sample, a quarter of the second
/// difference where it is, and a margin.
pub(super) fn curve_bounds(samples: &[DerivativeSample]) -> DerivativeSample {
    let mut bounds = [[0.0_f64; 3]; QUANTITIES];
    for three in samples.windows(3) {
        for (quantity, bounds) in bounds.iter_mut().enumerate() {
            for (order, bound) in bounds.iter_mut().enumerate() {
                let [before, here, behind] = [0, 1, 2].map(|at| three[at][quantity][order]);
                let bend = (before - 2.0 * here + behind).abs() / 4.0;
                *bound = bound.max(before.max(here).max(behind) + bend);
            }
        }
    }
    bounds.map(|orders| orders.map(|bound| bound * (1.0 + MARGIN)))
}

/// Derivatives by time at a position (in steps of the samples) with `s` as a function of time: upper bounds, as far as
/// sampled.
pub(super) fn at_time(sampled: &SampledPiece, place: f64, s: Jet) -> DerivativeSample {
    let step = place as usize;
    let (part, next) = (
        place - step as f64,
        (step + 1).min(sampled.samples.points.len() - 1),
    );
    let between = |a: f64, b: f64| a + (b - a) * part;
    let [_, v, a, j] = s.0;
    let mut sample = [[0.0; 3]; QUANTITIES];
    let amounts = [step, next].map(|step| sampled.samples.points[step]);
    let jets = [step, next].map(|step| sampled.samples.jets[step]);
    for (number, row) in sample.iter_mut().enumerate() {
        let slopes: [f64; 3] = core::array::from_fn(|order| match number {
            // Magnitudes: they are added without compensating each other.
            0 | 1 => between(amounts[0][number][order], amounts[1][number][order]),
            joint => between(
                jets[0][joint - 2].derivative(order + 1),
                jets[1][joint - 2].derivative(order + 1),
            ),
        });
        let [first, second, third] = slopes;
        *row = match number {
            0 | 1 => [
                first * v,
                second * v * v + first * a.abs(),
                third * v * v * v + 3.0 * second * v * a.abs() + first * j.abs(),
            ],
            _ => [
                (first * v).abs(),
                (second * v * v + first * a).abs(),
                (third * v * v * v + 3.0 * second * v * a + first * j).abs(),
            ],
        }
        .map(|value: f64| value * sampled.samples.excess);
    }
    sample
}
