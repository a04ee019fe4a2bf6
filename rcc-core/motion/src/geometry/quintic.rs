//! Quintic polynomials between two states, in several dimensions at once. Plain numbers; evaluated by the real-time
//! thread.

use super::jet::JetScalar;

/// Value, first and second derivative at one end.
pub type QuinticEnd<const N: usize> = [[f64; N]; 3];

/// A quintic curve over [0, length].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quintic<const N: usize> {
    length: f64,
    /// Coefficients of the powers 0 to 5 of s/length.
    coefficients: [[f64; 6]; N],
}

impl<const N: usize> Quintic<N> {
    /// The curve with the given value and first and second derivative at both ends; `length` > 0.
    #[must_use]
    pub fn between(from: QuinticEnd<N>, to: QuinticEnd<N>, length: f64) -> Self {
        let h = length;
        let mut coefficients = [[0.0; 6]; N];
        for (axis, row) in coefficients.iter_mut().enumerate() {
            let [p0, v0, a0] = from.map(|row| row[axis]);
            let [p1, v1, a1] = to.map(|row| row[axis]);
            let way = p1 - p0;
            let (v0, v1, a0, a1) = (v0 * h, v1 * h, a0 * h * h, a1 * h * h);
            *row = [
                p0,
                v0,
                a0 / 2.0,
                10.0 * way - 4.0 * v1 - 6.0 * v0 - 1.5 * a0 + 0.5 * a1,
                -15.0 * way + 7.0 * v1 + 8.0 * v0 + 1.5 * a0 - a1,
                6.0 * way - 3.0 * (v0 + v1) + 0.5 * (a1 - a0),
            ];
        }
        Self {
            length,
            coefficients,
        }
    }

    /// Coefficients of the powers 0 to 5 of s/length, one row for each dimension.
    #[must_use]
    pub fn coefficients(&self) -> &[[f64; 6]; N] {
        &self.coefficients
    }

    /// The value at `s`.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> [T; N] {
        let x = s.over(self.length);
        self.coefficients.map(|[a, b, c, d, e, f]| {
            let sum = |sum: T, next: f64| sum * x + T::constant(next);
            [e, d, c, b, a].into_iter().fold(T::constant(f), sum)
        })
    }

    /// The first derivative of the first `M` dimensions by s.
    #[inline]
    pub fn slope<const M: usize>(&self, s: f64) -> [f64; M] {
        const { assert!(M <= N) };
        let over = 1.0 / self.length;
        let x = s * over;
        core::array::from_fn(|axis| {
            let [_, b, c, d, e, f] = self.coefficients[axis];
            (b + x * (2.0 * c + x * (3.0 * d + x * (4.0 * e + x * 5.0 * f)))) * over
        })
    }
}
