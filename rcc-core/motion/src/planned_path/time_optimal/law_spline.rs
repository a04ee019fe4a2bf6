//! A time law as a uniform cubic B-spline over its duration, from rest to rest: its jerk is constant in each interval.
//! Used when a motion is built.

/// Basis functions that are not 0 in an interval.
pub(super) const ACTIVE: usize = 4;

/// Value and first three derivatives of a basis function.
pub(super) type Basis = [[f64; ACTIVE]; 4];

/// Path parameter over the fraction u of the duration, in [0, 1].
#[derive(Debug, Clone)]
pub(super) struct LawSpline {
    /// The first three are equal, and the last three: at rest at both ends.
    pub(super) coefficients: Vec<f64>,
}

/// The active basis functions at `x` in [0, 1] of an interval of length `step`: derivatives by u, order by order.
pub(super) fn basis(x: f64, step: f64) -> Basis {
    let y = 1.0 - x;
    let (x2, y2) = (x * x, y * y);
    let scale = [
        1.0 / 6.0,
        0.5 / step,
        1.0 / (step * step),
        1.0 / (step * step * step),
    ];
    let rows = [
        [
            y2 * y,
            3.0 * x2 * x - 6.0 * x2 + 4.0,
            3.0 * y2 * y - 6.0 * y2 + 4.0,
            x2 * x,
        ],
        [-y2, 3.0 * x2 - 4.0 * x, 4.0 * y - 3.0 * y2, x2],
        [y, 3.0 * x - 2.0, 1.0 - 3.0 * x, x],
        [-1.0, 3.0, -3.0, 1.0],
    ];
    core::array::from_fn(|order| rows[order].map(|value| value * scale[order]))
}

impl LawSpline {
    /// A spline of `intervals` (≥ 4) near the increasing function `at` of u, with its values at 0 and 1 at its ends.
    pub(super) fn near(intervals: usize, at: impl Fn(f64) -> f64) -> Self {
        /// Share of a uniform motion that is added, so that the law increases strictly.
        const UNIFORM: f64 = 1e-3;
        let (begin, end) = (at(0.0), at(1.0));
        let count = intervals + 3;
        let coefficient = |index: usize| {
            if index < 3 {
                return begin;
            }
            if index + 3 >= count {
                return end;
            }
            let even = (index - 2) as f64 / (count - 5) as f64;
            let u = (index - 1) as f64 / intervals as f64;
            (1.0 - UNIFORM) * at(u) + UNIFORM * (begin + (end - begin) * even)
        };
        let mut coefficients: Vec<f64> = (0..count).map(coefficient).collect();
        for index in 1..count {
            coefficients[index] = coefficients[index].max(coefficients[index - 1]);
        }
        Self { coefficients }
    }

    /// Number of intervals.
    pub(super) fn intervals(&self) -> usize {
        self.coefficients.len() - 3
    }

    /// Number of coefficients that are not fixed by the ends; the first of them has index 3.
    pub(super) fn free(&self) -> usize {
        self.coefficients.len() - 6
    }

    /// Value and derivatives by u in an interval, with the basis there.
    pub(super) fn at(&self, interval: usize, basis: &Basis) -> [f64; 4] {
        let near = &self.coefficients[interval..interval + ACTIVE];
        basis.map(|row| {
            row.iter()
                .zip(near)
                .map(|(weight, near)| weight * near)
                .sum()
        })
    }

    /// The same function with twice as many intervals.
    pub(super) fn halved(&self) -> Self {
        let old = &self.coefficients;
        let count = 2 * self.intervals() + 3;
        let coefficient = |index: usize| {
            let half = index / 2;
            match index % 2 {
                0 => (old[half] + old[half + 1]) / 2.0,
                _ => (old[half] + 6.0 * old[half + 1] + old[half + 2]) / 8.0,
            }
        };
        Self {
            coefficients: (0..count).map(coefficient).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wavy() -> LawSpline {
        LawSpline::near(8, |u| u + 0.05 * (6.0 * u).sin() * u * (1.0 - u))
    }

    fn value(law: &LawSpline, u: f64) -> [f64; 4] {
        let intervals = law.intervals();
        let number = ((u * intervals as f64) as usize).min(intervals - 1);
        let x = u * intervals as f64 - number as f64;
        law.at(number, &basis(x, 1.0 / intervals as f64))
    }

    #[test]
    fn a_law_is_at_rest_at_its_ends() {
        let law = wavy();
        for (u, s) in [(0.0, 0.0), (1.0, 1.0)] {
            let [found, velocity, acceleration, _] = value(&law, u);
            assert!(
                (found - s).abs() < 1e-14 && velocity.abs() < 1e-12 && acceleration.abs() < 1e-10
            );
        }
    }

    #[test]
    fn derivatives_match_differences() {
        let (law, d) = (wavy(), 1e-4);
        for u in [0.03, 0.2, 0.45, 0.55, 0.9] {
            let [before, here, behind] = [u - d, u, u + d].map(|u| value(&law, u));
            for order in 0..3 {
                let slope = (behind[order] - before[order]) / (2.0 * d);
                let want = here[order + 1];
                assert!(
                    (slope - want).abs() < 1e-4 * (1.0 + want.abs()),
                    "{u} {order}"
                );
            }
        }
    }

    #[test]
    fn halving_the_intervals_does_not_change_the_law() {
        let (law, fine) = (wavy(), wavy().halved());
        for number in 0..=40 {
            let u = f64::from(number) / 40.0;
            assert!((value(&law, u)[0] - value(&fine, u)[0]).abs() < 1e-14);
        }
    }
}
