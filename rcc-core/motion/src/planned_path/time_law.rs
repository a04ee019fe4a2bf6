//! Time law: the path parameter s as a function of time, from rest to rest, continuous up to the second derivative.
//! Computed when a motion is built; evaluated by the real-time thread in constant time.

use crate::geometry::jet::{Jet, JetScalar};
use crate::geometry::quintic::Quintic;

/// s and its first two derivatives by time.
pub(super) type TimeLawKnot = [f64; 3];

/// Bisections in the search for a time; the last ones are below the rounding of an f64.
const HALVINGS: usize = 60;

/// Path parameter as a function of time: quintic curves between equidistant knots.
#[derive(Debug, Clone)]
pub(crate) struct TimeLaw {
    begin_s: f64,
    end_s: f64,
    /// Duration of each curve, s.
    step_s: f64,
    curves: Box<[Quintic<1>]>,
}

impl TimeLaw {
    /// A time law through knots that are `step_s` (s) apart; `None` if s decreases anywhere, or there are fewer than
    /// two knots.
    pub(super) fn new(knots: &[TimeLawKnot], step_s: f64) -> Option<Self> {
        let end = |knot: TimeLawKnot| knot.map(|value| [value]);
        let pairs = knots.iter().zip(knots.iter().skip(1));
        let curves = pairs.map(|(from, to)| Quintic::between(end(*from), end(*to), step_s));
        let time_law = Self {
            begin_s: knots.first()?[0],
            end_s: knots.last()?[0],
            step_s,
            curves: curves.collect(),
        };
        let forward = time_law.curves.iter().all(|curve| {
            (0..=8).all(|part| {
                let [slope] = curve.slope(step_s * f64::from(part) / 8.0);
                slope >= -1e-12
            })
        });
        (forward && !time_law.curves.is_empty()).then_some(time_law)
    }

    /// Duration from rest to rest, s.
    pub(crate) fn duration(&self) -> f64 {
        self.step_s * self.curves.len() as f64
    }

    /// Path parameter s at a time in [0, duration].
    #[inline]
    pub(crate) fn at<T: JetScalar>(&self, time: T) -> T {
        let last = self.curves.len().saturating_sub(1);
        // The time is not negative; the cast turns NaN into 0.
        let number = ((time.value() / self.step_s) as usize).min(last);
        let Some(curve) = self.curves.get(number) else {
            return T::constant(f64::NAN);
        };
        let [s] = curve.at(time - T::constant(self.step_s * number as f64));
        s
    }

    /// Path parameter s at a time, limited to the ends.
    #[inline]
    pub(crate) fn position(&self, time: f64) -> f64 {
        self.at(time).max(self.begin_s).min(self.end_s)
    }

    /// Duration of each curve (s), and the number of curves.
    pub(super) fn curves(&self) -> (f64, usize) {
        (self.step_s, self.curves.len())
    }

    /// s with its derivatives, `time` (s) after the beginning of a curve.
    pub(super) fn on_curve(&self, number: usize, time: f64) -> Option<Jet> {
        let [s] = self.curves.get(number)?.at(Jet::variable(time));
        Some(s)
    }

    /// The first time at which s is reached, s.
    pub(super) fn inverse(&self, s: f64) -> f64 {
        if s <= self.begin_s {
            return 0.0;
        }
        if s >= self.end_s {
            return self.duration();
        }
        let (mut from, mut to) = (0.0, self.duration());
        for _ in 0..HALVINGS {
            let middle = 0.5 * (from + to);
            if self.position(middle) < s {
                from = middle;
            } else {
                to = middle;
            }
        }
        to
    }
}
