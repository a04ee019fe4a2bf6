//! The soonest time law within limits of velocity, acceleration and jerk, by a primal interior-point method. Used when a
//! motion is built.
//!
//! Unknowns are the coefficients of a B-spline s(u) over the fraction u of the duration, and θ = ln T, with the duration
//! T in s. Every limited value y of order p at a sample is g = y/limit with y ∝ e^(−pθ). Minimised is
//! θ − μ Σ ln(1 − g²) − μ Σ ln(c₍ᵢ₊₁₎ − cᵢ) for a decreasing μ (Nocedal, Wright: Numerical Optimization, 2006, section
//! 19.6), by Newton's method with the Hessian of the linearised g. Every iterate is within all limits, so the method can
//! end after any number of steps.

use super::super::speed_limits::QUANTITIES;
use super::banded::BorderedMatrix;
use super::law_spline::{Basis, LawSpline, basis};
use super::limited_values::{ClockReserve, Fraction, LimitedValues};
use super::local_model::{LocalModel, free_index, scatter};
use super::section_table::{SectionTable, Slopes};

/// Sampled places of each interval: near its ends, because the jerk jumps there, and between them.
const PLACES: [f64; 4] = [0.02, 0.35, 0.65, 0.98];

/// Intervals within which the third derivatives of the path beyond a boundary of two pieces apply as well: fully, and with
/// a decreasing weight.
const REACH: [f64; 2] = [0.35, 1.4];

/// μ times the number of limited values, at the beginning and at the end: about the relative distance of the duration
/// from the optimum.
const GAP_FIRST: f64 = 3.0;
const GAP_LAST: f64 = 0.003;

/// The same for a law that is to be found quickly.
const GAPS_QUICK: [f64; 2] = [0.3, 0.1];

/// The same at the beginning for a law that was improved with a greater reserve.
const GAP_RELAXED: f64 = 0.1;

/// Factor from one μ to the next.
const GAP_FACTOR: f64 = 0.3;

/// Newton steps for each μ, the least part of a step that is tried, and the decrease of the objective below which the next
/// μ follows.
const STEPS: usize = 12;
const PART_MIN: f64 = 1e-3;
const DECREASE_MIN: f64 = 1e-5;

/// Part of a limit that the first law uses at most, and a law that was refined: least and greatest.
const FIRST: [f64; 2] = [0.8, 0.98];
const REFINED: [f64; 2] = [0.99, 0.9999];

/// Fractions that are added to the diagonal of the Hessian, one after the other until a step succeeds.
const DAMPINGS: [f64; 4] = [1e-10, 1e-2, 1.0, 30.0];

/// Factors below 1 of which one logarithm is taken: their product cannot underflow.
const FACTORS: usize = 12;

/// A law within all limits, and its duration.
pub(super) struct Barrier<'a> {
    table: &'a SectionTable<'a>,
    values: LimitedValues,
    pub(super) law: LawSpline,
    /// Logarithm of the duration in s.
    theta: f64,
    matrix: BorderedMatrix,
    /// Gradient, then the step.
    step: Vec<f64>,
    /// Newton steps that were made.
    pub(super) steps: usize,
}

impl<'a> Barrier<'a> {
    /// Begins with a law; its duration is the shortest within the limits and a little more. `None` if there is none.
    pub(super) fn new(
        table: &'a SectionTable<'a>,
        reserve: ClockReserve,
        law: LawSpline,
    ) -> Option<Self> {
        let mut barrier = Self {
            table,
            values: LimitedValues::new(reserve),
            law,
            theta: 0.0,
            matrix: BorderedMatrix::default(),
            step: Vec::new(),
            steps: 0,
        };
        barrier.theta = barrier.within_limits(FIRST)?;
        Some(barrier)
    }

    /// Duration, s.
    pub(super) fn duration_s(&self) -> f64 {
        libm::exp(self.theta)
    }

    /// Improves the law from the first μ to the last, then with twice as many intervals until there are `intervals`.
    pub(super) fn improve(&mut self, intervals: usize) -> Option<()> {
        let mut gap = GAP_FIRST;
        loop {
            loop {
                self.newton(gap / self.count());
                if gap <= GAP_LAST {
                    break;
                }
                gap = (gap * GAP_FACTOR).max(GAP_LAST);
            }
            if self.law.intervals() >= intervals {
                return Some(());
            }
            self.law = self.law.halved();
            let used = self.greatest(self.theta);
            if used.iter().any(|used| used.is_nan() || *used >= REFINED[1]) {
                self.theta = self.within_limits(REFINED)?;
            }
            gap = GAP_LAST / GAP_FACTOR;
        }
    }

    /// Improves the law with its number of intervals and few μ.
    pub(super) fn improve_quickly(&mut self) {
        for gap in GAPS_QUICK {
            self.newton(gap / self.count());
        }
    }

    /// The law improved further with a lesser reserve.
    pub(super) fn relaxed(self, reserve: ClockReserve) -> Option<Self> {
        let mut relaxed = Self::new(self.table, reserve, self.law)?;
        for gap in [GAP_RELAXED, GAP_LAST] {
            relaxed.newton(gap / relaxed.count());
        }
        Some(relaxed)
    }

    /// About the number of limited values.
    fn count(&self) -> f64 {
        let [begin, _] = self.table.ends();
        let quantities = self.table.piece(begin).limited.len();
        let samples = self.law.intervals() * PLACES.len();
        (samples * quantities * self.values.of_joint()).max(1) as f64
    }

    /// Newton steps for one μ.
    fn newton(&mut self, mu: f64) {
        let Some(mut objective) = self.objective(&self.law, self.theta, mu) else {
            return;
        };
        for _ in 0..STEPS {
            let Some(decrease) = self.newton_step(mu, &mut objective) else {
                return;
            };
            self.steps += 1;
            if decrease < DECREASE_MIN {
                return;
            }
        }
    }

    /// One step, from this objective to a lesser one; returns the expected decrease, `None` if no part of the step
    /// decreases the objective.
    fn newton_step(&mut self, mu: f64, objective: &mut f64) -> Option<f64> {
        self.linearise(mu);
        let gradient = self.step.clone();
        let hessian = self.matrix.clone();
        // Where the third derivative of the path jumps, the model holds for a short step only.
        for damping in DAMPINGS {
            self.step.copy_from_slice(&gradient);
            self.matrix.clone_from(&hessian);
            self.matrix.damp(damping);
            self.matrix.solve(&mut self.step)?;
            let products = gradient.iter().zip(&self.step);
            let decrease: f64 = products.map(|(slope, step)| slope * step).sum();
            if decrease.is_nan() || decrease <= 0.0 {
                return None;
            }
            if self.search_along(objective, decrease, mu) {
                // The decrease of a damped step says nothing about the distance from the optimum.
                return Some(if damping > DAMPINGS[0] {
                    f64::INFINITY
                } else {
                    decrease
                });
            }
        }
        None
    }

    /// Takes the greatest part of the step that decreases the objective enough; false if there is none.
    fn search_along(&mut self, objective: &mut f64, decrease: f64, mu: f64) -> bool {
        let mut part = 1.0;
        let mut law = self.law.clone();
        while part > PART_MIN {
            let free = self.law.free();
            let coefficients = law.coefficients.iter_mut().zip(&self.law.coefficients);
            let steps = coefficients.skip(3).take(free).zip(&self.step);
            for ((new, old), step) in steps {
                *new = old - part * step;
            }
            let theta = self.theta - part * self.step.last().copied().unwrap_or(0.0);
            if let Some(less) = self.objective(&law, theta, mu)
                && less <= *objective - 1e-4 * part * decrease
            {
                (self.law, self.theta, *objective) = (law, theta, less);
                return true;
            }
            part *= 0.5;
        }
        false
    }

    /// Calls `each` for every limited value at a state of s and its derivatives by u, as fraction of its limit.
    fn fractions(&self, state: [f64; 4], decay: [f64; 3], mut each: impl FnMut(&Fraction)) {
        let [s, v, ..] = state;
        let piece = self.table.piece(s);
        let mut slopes: [Slopes; QUANTITIES] = [[0.0; 4]; QUANTITIES];
        piece.slopes(s, &mut slopes);
        let interval = v.abs() / self.law.intervals() as f64;
        let beside = piece.beside(s, REACH.map(|reach| reach * interval));
        for (limited, slopes) in piece.limited.iter().zip(slopes) {
            self.values
                .of_quantity(limited, slopes, (state, decay), 0, &mut each);
            if let Some((third, [weight, weight_slope])) = beside {
                let [f1, f2, f3, f4] = slopes;
                let more = third[limited.index] - f3;
                let slopes = [
                    f1,
                    f2,
                    f3 + weight * more,
                    (1.0 - weight) * f4 + weight_slope * more,
                ];
                self.values
                    .of_quantity(limited, slopes, (state, decay), 2, &mut each);
            }
        }
    }

    /// The law with its time stretched where the most of a limit is used; its duration is the shortest within the limits, and
    /// a little more.
    pub(super) fn evened(&self) -> Option<Self> {
        /// Intervals on each side over which the stretch is made smooth.
        const SIDE: usize = 2;
        let intervals = self.law.intervals();
        let (decay, bases) = (decay(self.theta), Self::bases(&self.law));
        let stretch = |interval: usize| {
            let mut most = 0.0_f64;
            for basis in &bases {
                self.fractions(self.law.at(interval, basis), decay, |fraction| {
                    most = most.max(fraction.value.abs());
                });
            }
            // As if each value were a third derivative: the least stretch.
            libm::cbrt(most).max(0.05)
        };
        let raw: Vec<f64> = (0..intervals).map(stretch).collect();
        let near = |number: usize| number.saturating_sub(SIDE)..(number + SIDE + 1).min(intervals);
        let greatest = |number: usize| raw[near(number)].iter().copied().fold(0.0, f64::max);
        let wide: Vec<f64> = (0..intervals).map(greatest).collect();
        let mean = |number: usize| {
            let range = near(number);
            let count = range.len() as f64;
            wide[range].iter().sum::<f64>() / count
        };
        let mut times = vec![0.0];
        for number in 0..intervals {
            times.push(times[number] + mean(number));
        }
        let whole = times[intervals];
        let ends = [0.0, 1.0].map(|x| basis(x, 1.0 / intervals as f64));
        let law = LawSpline::near(intervals, |u| {
            let time = u * whole;
            let next = times
                .partition_point(|begin| *begin <= time)
                .clamp(1, intervals);
            let part = (time - times[next - 1]) / (times[next] - times[next - 1]);
            if part <= 0.0 {
                return self.law.at(next - 1, &ends[0])[0];
            }
            if part >= 1.0 {
                return self.law.at(next - 1, &ends[1])[0];
            }
            self.law.at(next - 1, &basis(part, 1.0 / intervals as f64))[0]
        });
        let mut evened = Self {
            table: self.table,
            values: LimitedValues::new(ClockReserve::default()),
            law,
            theta: self.theta,
            matrix: BorderedMatrix::default(),
            step: Vec::new(),
            steps: 0,
        };
        evened.theta = evened.within_limits(FIRST)?;
        Some(evened)
    }

    /// The bases at [`PLACES`].
    fn bases(law: &LawSpline) -> [Basis; PLACES.len()] {
        let step = 1.0 / law.intervals() as f64;
        PLACES.map(|x| basis(x, step))
    }

    /// The greatest fraction of a limit at any sample, for each order.
    fn greatest(&self, theta: f64) -> [f64; 3] {
        let decay = decay(theta);
        let bases = Self::bases(&self.law);
        let mut greatest = [0.0_f64; 3];
        for interval in 0..self.law.intervals() {
            for basis in &bases {
                self.fractions(self.law.at(interval, basis), decay, |fraction| {
                    let greatest = &mut greatest[fraction.order];
                    *greatest = greatest.max(fraction.value.abs());
                });
            }
        }
        greatest
    }

    /// The logarithm of a duration with which the law is within all limits: at least `least` and at most `most` of one is
    /// used.
    fn within_limits(&self, [least, most]: [f64; 2]) -> Option<f64> {
        const TRIALS: usize = 100;
        let aim = 0.5 * (least + most);
        let mut theta = self.theta;
        for _ in 0..TRIALS {
            let greatest = self.greatest(theta);
            let used = greatest.iter().copied().fold(0.0, f64::max);
            if !used.is_finite() {
                return None;
            }
            if (least..=most).contains(&used) {
                return Some(theta);
            }
            // Exact without a reserve, when a value of order p is proportional to e^(−pθ).
            let more = greatest
                .iter()
                .zip([1.0, 2.0, 3.0])
                .map(|(used, power)| libm::log(used.max(f64::MIN_POSITIVE) / aim) / power);
            theta += more.fold(f64::NEG_INFINITY, f64::max);
        }
        None
    }

    /// The objective; `None` if a limit is exceeded or the law does not increase.
    fn objective(&self, law: &LawSpline, theta: f64, mu: f64) -> Option<f64> {
        let mut logarithms = 0.0;
        let mut factors = (1.0, 0);
        let mut factor = |value: f64| {
            factors = (factors.0 * value, factors.1 + 1);
            if factors.1 == FACTORS {
                logarithms += libm::log(factors.0);
                factors = (1.0, 0);
            }
        };
        let moving = law.coefficients.get(2..law.coefficients.len() - 2)?;
        for pair in moving.windows(2) {
            let rise = pair[1] - pair[0];
            if rise.is_nan() || rise <= 0.0 {
                return None;
            }
            factor(rise);
        }
        let (decay, bases) = (decay(theta), Self::bases(law));
        let mut inside = true;
        for interval in 0..law.intervals() {
            for basis in &bases {
                self.fractions(law.at(interval, basis), decay, |fraction| {
                    let left = 1.0 - fraction.value * fraction.value;
                    inside &= left > 0.0;
                    factor(left);
                });
            }
            if !inside {
                return None;
            }
        }
        let objective = theta - mu * (logarithms + libm::log(factors.0));
        objective.is_finite().then_some(objective)
    }

    /// Writes the gradient to `step` and the Hessian to `matrix`.
    fn linearise(&mut self, mu: f64) {
        let free = self.law.free();
        let mut matrix = core::mem::take(&mut self.matrix);
        let mut gradient = core::mem::take(&mut self.step);
        matrix.clear(free);
        gradient.clear();
        gradient.resize(free + 1, 0.0);
        let (decay, bases) = (decay(self.theta), Self::bases(&self.law));
        let theta = free;
        for interval in 0..self.law.intervals() {
            for basis in &bases {
                let mut local = LocalModel::default();
                self.fractions(self.law.at(interval, basis), decay, |fraction| {
                    local.add(fraction, mu);
                });
                gradient[theta] += local.gradient[4];
                matrix.corner += local.hessian[4][4];
                scatter(&local, basis, interval, (&mut matrix, &mut gradient));
            }
        }
        gradient[theta] += 1.0;
        let coefficients = &self.law.coefficients;
        for index in 2..coefficients.len() - 3 {
            let slope = mu / (coefficients[index + 1] - coefficients[index]);
            let bend = slope * slope / mu;
            let [low, high] = [index, index + 1].map(|index| free_index(index, free));
            if let Some(low) = low {
                gradient[low] += slope;
                matrix.add(low, low, bend);
            }
            if let Some(high) = high {
                gradient[high] -= slope;
                matrix.add(high, high, bend);
            }
            if let (Some(low), Some(high)) = (low, high) {
                matrix.add(high, low, -bend);
            }
        }
        (self.matrix, self.step) = (matrix, gradient);
    }
}

/// e^(−θ), e^(−2θ), e^(−3θ).
fn decay(theta: f64) -> [f64; 3] {
    let first = libm::exp(-theta);
    [first, first * first, first * first * first]
}
