//! The time-optimal time law of a path from rest to rest under velocity and acceleration limits, smoothed to bounded
//! jerk. Used when a motion is built; allocates.
//!
//! Pham, Pham: "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", IEEE T-RO 34(3),
//! 2018 (TOPP-RA). With x = s'² and u = s'' all limits are linear. Backward pass: the greatest x from which the end can
//! still be reached; forward pass: the greatest u that stays below it. Both are linear programs in two variables,
//! solved directly.
//!
//! The result jumps between accelerations. Its moving average over a short window has bounded jerk; a shorter window
//! ends sooner but leaves less of the jerk limit. The smoothed law is sampled, and slowed down by its clock where it
//! exceeds a limit, so keeping the limits does not depend on its quality.

use core::ops::Range;

use super::sampled_path::{SampledPath, SampledPiece};
use super::speed_limits::{
    DerivativeSample, LimitShares, QUANTITIES, QuantityLimits, SampledPart, TIME_LAW_SHARES,
    fastest_bounds, widen,
};
use super::time_law::{TimeLaw, TimeLawKnot};
use crate::geometry::chain::ChainPiece;
use crate::geometry::jet::{Jet, JetScalar};
use crate::path_clock::{PathBounds, rolling_duration_s};

/// Fraction of the velocity limits; where the smoothed law is faster, the clock slows it down.
const VELOCITY: f64 = 0.98;

/// Fraction of the jerk limit for passing a bend at constant speed.
const BEND_JERK: f64 = 0.45;

/// Windows that are tried, relative to the one that uses [`WINDOW_JERK`] of the jerk limit.
const WINDOWS: [f64; 3] = [0.4, 0.7, 1.1];

/// Fraction of the jerk limit for changing from one acceleration to the opposite one within a window.
const WINDOW_JERK: f64 = 0.65;

/// Knots of a time law per window, and their greatest number in total.
const KNOTS: f64 = 8.0;
const KNOTS_MAX: f64 = 2048.0;

/// Number of parts in which a curve of a time law is sampled: least and greatest.
const PARTS: f64 = 4.0;
const PARTS_MAX: f64 = 512.0;

/// Parts of a piece that may have separate velocity limits.
const SPLIT: usize = 8;

/// Constraints on x and u at one path position.
struct PathConstraints {
    s: f64,
    /// The greatest x with |y'|v ≤ velocity limit.
    fastest: f64,
    /// Rows a·u + b·x ≤ c.
    rows: Vec<[f64; 3]>,
}

/// The time law with the shortest duration, with the limits of its clock; `None` if no law is faster than `uniform_s`
/// (s).
pub(super) fn time_optimal_law(
    path: &SampledPath<'_>,
    range: Range<usize>,
    uniform_s: f64,
) -> Option<(TimeLaw, PathBounds)> {
    let mut best: Option<(f64, TimeLaw, PathBounds)> = None;
    let window_s = WINDOW_JERK.recip() * ramp_time_s(path, range.clone())?;
    for (part, shares) in &TIME_LAW_SHARES {
        let constraints = constraints(path, range.clone(), *part);
        let Some(profile) = AccelerationProfile::new(&constraints) else {
            continue;
        };
        for window in WINDOWS {
            let window_s = (window * 2.0 * part * window_s).min(profile.duration_s());
            let smoothed_law = smoothed_law(path, range.clone(), (&profile, shares), window_s);
            let Some((time_law, bounds)) = smoothed_law else {
                continue;
            };
            let time_s = rolling_duration_s(&bounds, time_law.duration());
            let least = best.as_ref().map_or(uniform_s, |(least, ..)| *least);
            if time_s < least {
                best = Some((time_s, time_law, bounds));
            }
        }
    }
    best.map(|(_, time_law, bounds)| (time_law, bounds))
}

/// The longest time in which a limited quantity builds up its greatest acceleration, s.
fn ramp_time_s(path: &SampledPath<'_>, range: Range<usize>) -> Option<f64> {
    let sampled = path.pieces.get(range)?;
    let rows = sampled.iter().flat_map(|sampled| &sampled.bounds);
    let times = rows
        .filter(|[_, a, _]| a.is_finite())
        .map(|[_, a, j]| a / j);
    let longest = times.fold(0.0, f64::max);
    (longest > 0.0).then_some(longest)
}

/// A time law from this profile, smoothed over `window_s` (s), with the limits of its clock.
fn smoothed_law(
    path: &SampledPath<'_>,
    range: Range<usize>,
    (profile, shares): (&AccelerationProfile, &LimitShares),
    window_s: f64,
) -> Option<(TimeLaw, PathBounds)> {
    let (knots, step_s) = profile.smooth(window_s)?;
    let time_law = TimeLaw::new(&knots, step_s)?;
    let (mut parts, mut ends) = (Vec::new(), Vec::new());
    for number in range.filter(|number| path.has_length(*number)) {
        let (piece, sampled) = (path.chain.pieces().get(number)?, path.pieces.get(number)?);
        let (from, to) = (time_law.inverse(piece.begin), time_law.inverse(piece.end));
        let (times, samples): (Vec<f64>, Vec<DerivativeSample>) =
            by_time(&time_law, piece, sampled, [from, to])
                .into_iter()
                .unzip();
        let samples = widen(&samples);
        let last = samples.len().checked_sub(1)?;
        for part in 0..SPLIT {
            let (first, end) = (last * part / SPLIT, last * (part + 1) / SPLIT);
            parts.push(SampledPart {
                samples: samples.get(first..=end)?.to_vec(),
                bounds: sampled.bounds,
                given: false,
            });
            ends.push(if part + 1 == SPLIT {
                to
            } else {
                *times.get(end)?
            });
        }
    }
    let bounds = fastest_bounds(&parts, &ends, path.dt_s, shares).ok()?;
    Some((time_law, bounds))
}

/// Derivatives by time along a piece, from one time to another: at the ends of each curve of the law, and between them
/// as densely as the piece was sampled.
fn by_time(
    time_law: &TimeLaw,
    piece: &ChainPiece,
    sampled: &SampledPiece,
    [from, to]: [f64; 2],
) -> Vec<(f64, DerivativeSample)> {
    let (step_s, count) = time_law.curves();
    let steps = sampled.samples.points.len().saturating_sub(1).max(1) as f64;
    let close = piece.length() / steps;
    let (first, last) = (from / step_s, to / step_s);
    let mut all = Vec::new();
    for number in first as usize..(last.ceil() as usize).min(count) {
        let begin = number as f64;
        let span = [(first - begin).max(0.0), (last - begin).min(1.0)].map(|part| part * step_s);
        let ways = span.map(|time| {
            time_law
                .on_curve(number, time)
                .map_or(0.0, JetScalar::value)
        });
        let parts = ((ways[1] - ways[0]) / close).ceil().clamp(PARTS, PARTS_MAX);
        for part in 0..=parts as usize {
            let time = span[0] + (span[1] - span[0]) * part as f64 / parts;
            let Some(s) = time_law.on_curve(number, time) else {
                continue;
            };
            let place = ((s.value() - piece.begin) / close).clamp(0.0, steps);
            all.push((begin * step_s + time, at_time(sampled, place, s)));
        }
    }
    all
}

/// Derivatives by time at a position (in steps of the samples) with `s` as a function of time: upper bounds, as far as
/// sampled.
fn at_time(sampled: &SampledPiece, place: f64, s: Jet) -> DerivativeSample {
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

/// The constraints at every sample, with the fraction `part` of the acceleration limits.
fn constraints(path: &SampledPath<'_>, range: Range<usize>, part: f64) -> Vec<PathConstraints> {
    let mut constraints = Vec::new();
    for number in range.filter(|number| path.has_length(*number)) {
        let (Some(piece), Some(sampled)) =
            (path.chain.pieces().get(number), path.pieces.get(number))
        else {
            continue;
        };
        let samples = sampled.samples.points.iter().zip(&sampled.samples.jets);
        let steps = sampled.samples.points.len().saturating_sub(1).max(1);
        for (step, (sample, jets)) in samples.enumerate() {
            let mut slopes = *sample;
            for (slope, jet) in slopes.iter_mut().skip(2).zip(jets) {
                *slope = [1, 2, 3].map(|order| jet.derivative(order));
            }
            let s = piece.begin + piece.length() * step as f64 / steps as f64;
            constraints.push(PathConstraints::new(s, &slopes, &sampled.bounds, part));
        }
    }
    constraints
}

impl PathConstraints {
    /// `slopes` are derivatives by s: magnitudes for translation and rotation, signed values for joints.
    fn new(s: f64, slopes: &DerivativeSample, bounds: &QuantityLimits, part: f64) -> Self {
        let (mut fastest, mut rows) = (f64::INFINITY, Vec::new());
        for (number, ([first, second, third], [v, a, j])) in slopes.iter().zip(bounds).enumerate() {
            if !a.is_finite() && !v.is_finite() {
                continue;
            }
            let in_bend = libm::cbrt(BEND_JERK * j / third.abs());
            for speed in [VELOCITY * v / first.abs(), in_bend] {
                if speed * speed < fastest {
                    fastest = speed * speed;
                }
            }
            if !a.is_finite() {
                continue;
            }
            let limit = part * a;
            // With magnitudes it is unknown whether they add or compensate: assume both.
            let other = if number < 2 { *second } else { -second };
            rows.push([*first, *second, limit]);
            rows.push([-first, other, limit]);
        }
        Self { s, fastest, rows }
    }

    /// The interval of u that is allowed at x, as [low, high].
    fn between(&self, x: f64) -> [f64; 2] {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for [a, b, c] in &self.rows {
            let at = (c - b * x) / a;
            if *a > 0.0 {
                high = high.min(at);
            } else if *a < 0.0 {
                low = low.max(at);
            }
        }
        [low, high]
    }

    /// The greatest x from which x + 2·step·u can be in [0, next].
    fn greatest(&mut self, step: f64, next: f64) -> f64 {
        self.rows.push([2.0 * step, 1.0, next]);
        self.rows.push([-2.0 * step, -1.0, 0.0]);
        let mut greatest = self.fastest;
        for [a, b, c] in &self.rows {
            if *a == 0.0 && *b > 0.0 {
                greatest = greatest.min(c / b);
            }
            if *a <= 0.0 {
                continue;
            }
            for [a2, b2, c2] in self.rows.iter().filter(|[a2, ..]| *a2 < 0.0) {
                // Upper bound: (c − b·x)/a. Lower bound: (c2 − b2·x)/a2.
                let (gap, fall) = (c / a - c2 / a2, b / a - b2 / a2);
                if fall > 0.0 {
                    greatest = greatest.min(gap / fall);
                }
            }
        }
        greatest.max(0.0)
    }
}

/// Consecutive phases of constant acceleration, with the integral of s over time.
struct AccelerationProfile {
    /// Per knot: time, s, speed, acceleration from there on, ∫ s dt.
    knots: Vec<[f64; 5]>,
}

impl AccelerationProfile {
    /// The time-optimal profile under the constraints; `None` if there is none.
    fn new(constraints: &[PathConstraints]) -> Option<Self> {
        let steps = constraints.iter().zip(constraints.iter().skip(1));
        let steps: Vec<f64> = steps.map(|(from, to)| to.s - from.s).collect();
        let mut reachable = vec![0.0; constraints.len()];
        let mut limits = Vec::with_capacity(constraints.len());
        for (number, place) in constraints.iter().enumerate().rev() {
            let mut place = PathConstraints {
                rows: place.rows.clone(),
                ..*place
            };
            if let (Some(step), Some(next)) = (steps.get(number), reachable.get(number + 1)) {
                let greatest = place.greatest(*step, *next);
                *reachable.get_mut(number)? = greatest;
            }
            limits.push(place);
        }
        limits.reverse();
        let (mut knots, mut x) = (Vec::new(), 0.0_f64);
        let [mut t, mut integral] = [0.0; 2];
        for (number, step) in steps.iter().enumerate() {
            let (place, next) = (limits.get(number)?, *reachable.get(number + 1)?);
            let [low, high] = place.between(x);
            let u = if *step > 0.0 { high.max(low) } else { 0.0 };
            let behind = (x + 2.0 * step * u).min(next).max(0.0);
            let (from, to) = (libm::sqrt(x), libm::sqrt(behind));
            let s = place.s;
            if *step > 0.0 {
                let time = 2.0 * step / (from + to);
                if !time.is_finite() {
                    return None;
                }
                let u = (to - from) / time;
                knots.push([t, s, from, u, integral]);
                integral += time * (s + time * (from / 2.0 + time * u / 6.0));
                t += time;
            }
            x = behind;
        }
        knots.push([t, constraints.last()?.s, 0.0, 0.0, integral]);
        (knots.len() > 1).then_some(Self { knots })
    }

    fn duration_s(&self) -> f64 {
        self.knots.last().map_or(0.0, |[t, ..]| *t)
    }

    /// ∫ s dt, s and s' at a time; at rest before the beginning and after the end.
    fn at(&self, time: f64) -> [f64; 3] {
        let number = self.knots.partition_point(|[t, ..]| *t <= time);
        let first = number.saturating_sub(1);
        let Some([t, s, v, u, integral]) = self.knots.get(first) else {
            return [0.0; 3];
        };
        let d = time - t;
        if d < 0.0 {
            return [integral + s * d, *s, 0.0];
        }
        [
            integral + d * (s + d * (v / 2.0 + d * u / 6.0)),
            s + d * (v + d * u / 2.0),
            v + d * u,
        ]
    }

    /// The moving average over a window: the knots of a time law and the time between them, s.
    fn smooth(&self, window_s: f64) -> Option<(Vec<TimeLawKnot>, f64)> {
        let duration = self.duration_s() + window_s;
        let count = (KNOTS * duration / window_s).ceil().min(KNOTS_MAX);
        if !(count >= 1.0 && window_s > 0.0) {
            return None;
        }
        let step_s = duration / count;
        let (first, last) = (self.knots.first()?[1], self.knots.last()?[1]);
        let knot = |number: usize| {
            let time = step_s * number as f64;
            let [now, before] = [self.at(time), self.at(time - window_s)];
            let [s, v, a] = [0, 1, 2].map(|order| (now[order] - before[order]) / window_s);
            [s, v, a]
        };
        let count = count as usize;
        let mut knots: Vec<TimeLawKnot> = (0..=count).map(knot).collect();
        // Exactly at rest at both ends.
        *knots.first_mut()? = [first, 0.0, 0.0];
        *knots.last_mut()? = [last, 0.0, 0.0];
        Some((knots, step_s))
    }
}

#[cfg(test)]
mod tests;
