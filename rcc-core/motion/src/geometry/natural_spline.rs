//! The smoothest curve through points: the natural quintic spline, which minimizes the mean square of the third
//! derivative and is continuous up to the fourth. Solved when a motion is built.
//!
//! De Boor, "A Practical Guide to Splines", chapter XIII (natural splines of order 2m, here m = 3).

use nalgebra::{Matrix2, SMatrix};

use super::quintic::Quintic;

/// First and second derivative at a knot, one column per axis.
type KnotDerivatives<const N: usize> = SMatrix<f64, 2, N>;

/// The curves between points `values` at increasing `knots` (equal numbers, two or more); `None` if the equations have
/// no solution.
pub fn natural<const N: usize>(knots: &[f64], values: &[[f64; N]]) -> Option<Vec<Quintic<N>>> {
    let slopes = slopes(knots, values)?;
    let end = |number: usize| {
        let (value, slopes) = (values.get(number)?, slopes.get(number)?);
        let row = |row: usize| core::array::from_fn(|axis| slopes[(row, axis)]);
        Some([*value, row(0), row(1)])
    };
    let spans = knots.iter().zip(knots.iter().skip(1)).enumerate();
    spans
        .map(|(number, (from, to))| {
            Some(Quintic::between(end(number)?, end(number + 1)?, to - from))
        })
        .collect()
}

/// One interval between knots: its length, and the difference of the values.
struct KnotSpan<const N: usize> {
    length: f64,
    way: SMatrix<f64, 1, N>,
}

/// Equations at one knot: coefficients of the derivatives at the knot before, here and behind, and the right-hand side.
struct KnotEquation<const N: usize> {
    before: Matrix2<f64>,
    here: Matrix2<f64>,
    behind: Matrix2<f64>,
    right: KnotDerivatives<N>,
}

impl<const N: usize> KnotEquation<N> {
    /// Continuity: third and fourth derivative at the end of the interval before equal those at the beginning of the
    /// interval behind.
    fn new(before: Option<&KnotSpan<N>>, behind: Option<&KnotSpan<N>>) -> Self {
        let mut row = KnotEquation {
            before: Matrix2::zeros(),
            here: Matrix2::zeros(),
            behind: Matrix2::zeros(),
            right: KnotDerivatives::zeros(),
        };
        if let Some(KnotSpan { length: h, way }) = before {
            let (h2, h3) = (h * h, h * h * h);
            row.before = Matrix2::new(-24.0 / h2, -3.0 / h, -168.0 / h3, -24.0 / h2);
            row.here += Matrix2::new(-36.0 / h2, 9.0 / h, -192.0 / h3, 36.0 / h2);
            row.add(way, [-60.0 / h3, -360.0 / (h3 * h)]);
        }
        if let Some(KnotSpan { length: h, way }) = behind {
            let (h2, h3) = (h * h, h * h * h);
            row.behind = Matrix2::new(24.0 / h2, -3.0 / h, -168.0 / h3, 24.0 / h2);
            row.here += Matrix2::new(36.0 / h2, 9.0 / h, -192.0 / h3, -36.0 / h2);
            row.add(way, [60.0 / h3, -360.0 / (h3 * h)]);
        }
        row
    }

    fn add(&mut self, way: &SMatrix<f64, 1, N>, factors: [f64; 2]) {
        for (mut right, factor) in self.right.row_iter_mut().zip(factors) {
            right += way * factor;
        }
    }
}

/// Derivatives at all knots: block elimination (Thomas algorithm with 2×2 blocks), then back substitution.
fn slopes<const N: usize>(knots: &[f64], values: &[[f64; N]]) -> Option<Vec<KnotDerivatives<N>>> {
    let pairs = knots.iter().zip(values);
    let spans: Vec<KnotSpan<N>> = pairs
        .clone()
        .zip(pairs.skip(1))
        .map(|((from, a), (to, b))| KnotSpan {
            length: to - from,
            way: SMatrix::from_fn(|_, axis| b[axis] - a[axis]),
        })
        .collect();
    if let [KnotSpan { length, way }] = spans.as_slice() {
        // Two points: a straight line.
        let mut slopes = KnotDerivatives::<N>::zeros();
        slopes.set_row(0, &(way / *length));
        return Some(vec![slopes; 2]);
    }
    let mut solved: Vec<(Matrix2<f64>, KnotDerivatives<N>)> = Vec::new();
    for number in 0..knots.len() {
        let before = number.checked_sub(1).and_then(|number| spans.get(number));
        let row = KnotEquation::new(before, spans.get(number));
        let (mut here, mut right) = (row.here, row.right);
        if let Some((factor, known)) = solved.last() {
            here -= row.before * factor;
            right -= row.before * known;
        }
        let inverse = here.try_inverse()?;
        solved.push((inverse * row.behind, inverse * right));
    }
    let mut slopes: Vec<KnotDerivatives<N>> = Vec::new();
    for (factor, known) in solved.iter().rev() {
        let behind = slopes
            .last()
            .copied()
            .unwrap_or_else(KnotDerivatives::zeros);
        slopes.push(known - factor * behind);
    }
    slopes.reverse();
    let finite = slopes.iter().flatten().all(|slope| slope.is_finite());
    finite.then_some(slopes)
}
