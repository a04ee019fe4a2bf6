//! The time-optimal profile of a path from rest to rest under velocity and acceleration limits: from it the search for the
//! soonest law with a jerk limit begins. Used when a motion is built; allocates.
//!
//! Pham, Pham: "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", IEEE T-RO 34(3),
//! 2018 (TOPP-RA). With x = s'² and u = s'' all limits are linear. Backward pass: the greatest x from which the end can
//! still be reached; forward pass: the greatest u that stays below it. Both are linear programs in two variables,
//! solved directly.

use core::ops::Range;

use super::super::sampled_path::SampledPath;
use super::super::speed_limits::{DerivativeSample, QuantityLimits};

/// Fraction of the jerk limit for passing a bend at constant speed.
const BEND_JERK: f64 = 0.7;

/// Constraints on x and u at one path position.
pub(super) struct PathConstraints {
    s: f64,
    /// The greatest x with |y'|v ≤ velocity limit.
    fastest: f64,
    /// Rows a·u + b·x ≤ c.
    rows: Vec<[f64; 3]>,
}

/// The constraints at every sample.
pub(super) fn constraints(path: &SampledPath<'_>, range: Range<usize>) -> Vec<PathConstraints> {
    let mut constraints = Vec::new();
    for (piece, sampled) in path.with_length(range) {
        let samples = sampled.samples.points.iter().zip(&sampled.samples.jets);
        let steps = sampled.samples.points.len().saturating_sub(1).max(1);
        for (step, (sample, jets)) in samples.enumerate() {
            let mut slopes = *sample;
            for (slope, jet) in slopes.iter_mut().skip(2).zip(jets) {
                *slope = [1, 2, 3].map(|order| jet.derivative(order));
            }
            let s = piece.begin + piece.length() * step as f64 / steps as f64;
            constraints.push(PathConstraints::new(s, &slopes, &sampled.bounds));
        }
    }
    constraints
}

impl PathConstraints {
    /// `slopes` are derivatives by s: magnitudes for translation and rotation, signed values for joints.
    pub(super) fn new(s: f64, slopes: &DerivativeSample, bounds: &QuantityLimits) -> Self {
        let (mut fastest, mut rows) = (f64::INFINITY, Vec::new());
        for (number, ([first, second, third], [v, a, j])) in slopes.iter().zip(bounds).enumerate() {
            if !a.is_finite() && !v.is_finite() {
                continue;
            }
            let in_bend = libm::cbrt(BEND_JERK * j / third.abs());
            for speed in [v / first.abs(), in_bend] {
                if speed * speed < fastest {
                    fastest = speed * speed;
                }
            }
            if !a.is_finite() {
                continue;
            }
            // With magnitudes it is unknown whether they add or compensate: assume both.
            let other = if number < 2 { *second } else { -second };
            rows.push([*first, *second, *a]);
            rows.push([-first, other, *a]);
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
pub(super) struct AccelerationProfile {
    /// Per knot: time, s, speed, acceleration from there on, ∫ s dt.
    knots: Vec<[f64; 5]>,
}

impl AccelerationProfile {
    /// The time-optimal profile under the constraints; `None` if there is none.
    pub(super) fn new(constraints: &[PathConstraints]) -> Option<Self> {
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

    pub(super) fn duration_s(&self) -> f64 {
        self.knots.last().map_or(0.0, |[t, ..]| *t)
    }

    /// ∫ s dt at a time; at rest before the beginning and after the end.
    fn integral(&self, time: f64) -> f64 {
        let number = self.knots.partition_point(|[t, ..]| *t <= time);
        let first = number.saturating_sub(1);
        let Some([t, s, v, u, integral]) = self.knots.get(first) else {
            return 0.0;
        };
        let d = time - t;
        if d < 0.0 {
            return integral + s * d;
        }
        integral + d * (s + d * (v / 2.0 + d * u / 6.0))
    }

    /// The moving average of s over `window_s` (s), which takes one window longer, at the fraction `u` of its duration.
    pub(super) fn averaged(&self, window_s: f64, u: f64) -> f64 {
        let ends = [self.knots.first(), self.knots.last()];
        let [first, last] = ends.map(|knot| knot.map_or(0.0, |[_, s, ..]| *s));
        if u <= 0.0 {
            return first;
        }
        if u >= 1.0 {
            return last;
        }
        let time = u * (self.duration_s() + window_s);
        let average = (self.integral(time) - self.integral(time - window_s)) / window_s;
        average.max(first).min(last)
    }
}

#[cfg(test)]
mod tests;
