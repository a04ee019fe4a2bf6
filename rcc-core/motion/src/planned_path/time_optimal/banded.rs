//! Linear systems of a time law: a symmetric positive definite matrix with three diagonals on each side, bordered by one
//! row and column for the duration. Used when a motion is built.

/// Diagonals on each side.
pub(super) const BAND: usize = 3;

/// A symmetric matrix in which element (i, j) is 0 for |i − j| > [`BAND`], bordered by one row and column.
#[derive(Debug, Clone, Default)]
pub(super) struct BorderedMatrix {
    /// Row i: elements (i, i − 3) to (i, i).
    pub(super) rows: Vec<[f64; BAND + 1]>,
    /// Elements of the border.
    pub(super) border: Vec<f64>,
    /// The element in the corner.
    pub(super) corner: f64,
}

impl BorderedMatrix {
    /// Sets the matrix to 0, with `size` rows before the border; allocates only if it grows.
    pub(super) fn clear(&mut self, size: usize) {
        self.rows.clear();
        self.rows.resize(size, [0.0; BAND + 1]);
        self.border.clear();
        self.border.resize(size, 0.0);
        self.corner = 0.0;
    }

    /// Adds to element (i, j) and to (j, i), for i ≥ j.
    pub(super) fn add(&mut self, i: usize, j: usize, value: f64) {
        if let Some(element) = self
            .rows
            .get_mut(i)
            .and_then(|row| row.get_mut((j + BAND).wrapping_sub(i)))
        {
            *element += value;
        }
    }

    /// Increases the diagonal before the border by a fraction.
    pub(super) fn damp(&mut self, fraction: f64) {
        for row in &mut self.rows {
            row[BAND] *= 1.0 + fraction;
        }
    }

    /// Solves the system in place by Cholesky's method; `right` has the element of the border at its end. `None` if the
    /// matrix is not positive definite. The matrix is overwritten.
    pub(super) fn solve(&mut self, right: &mut [f64]) -> Option<()> {
        let (last, right) = right.split_last_mut()?;
        self.factorize()?;
        self.substitute(right);
        let border = self.border.clone();
        let mut column = border.clone();
        self.substitute(&mut column);
        let product = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let pivot = self.corner - product(&border, &column);
        let value = (*last - product(&border, right)) / pivot;
        if !(pivot > 0.0 && value.is_finite()) {
            return None;
        }
        *last = value;
        for (element, column) in right.iter_mut().zip(&column) {
            *element -= column * value;
        }
        right.iter().all(|value| value.is_finite()).then_some(())
    }

    /// Replaces the rows by their Cholesky factor, with the reciprocal of each pivot on the diagonal.
    fn factorize(&mut self) -> Option<()> {
        let mut before = [[0.0; BAND + 1]; BAND];
        for row in &mut self.rows {
            // `before[k]` is row i − 3 + k of the factor; element (r, c) of it is at c − r + 3.
            let mut factor = *row;
            for column in 0..BAND {
                let mut value = factor[column];
                for inner in 0..column {
                    // Column i − 3 + inner of row i − 3 + column.
                    value -= factor[inner] * before[column][inner + BAND - column];
                }
                factor[column] = value * before[column][BAND];
            }
            let squares: f64 = factor[..BAND].iter().map(|value| value * value).sum();
            let pivot = factor[BAND] - squares;
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            factor[BAND] = 1.0 / libm::sqrt(pivot);
            *row = factor;
            before = [before[1], before[2], factor];
        }
        Some(())
    }

    /// Solves with the factor, in place.
    fn substitute(&self, right: &mut [f64]) {
        for i in 0..right.len() {
            let row = self.rows[i];
            let mut value = right[i];
            for back in 1..=BAND.min(i) {
                value -= row[BAND - back] * right[i - back];
            }
            right[i] = value * row[BAND];
        }
        for i in (0..right.len()).rev() {
            let mut value = right[i];
            for ahead in 1..=BAND.min(right.len() - 1 - i) {
                value -= self.rows[i + ahead][BAND - ahead] * right[i + ahead];
            }
            right[i] = value * self.rows[i][BAND];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::needless_range_loop)] // Two rows and two columns at a time.
    fn the_solution_solves_the_system() {
        let size = 9;
        let mut matrix = BorderedMatrix::default();
        matrix.clear(size);
        let mut full = vec![vec![0.0; size + 1]; size + 1];
        for i in 0..size {
            for j in i.saturating_sub(BAND)..=i {
                let value = if i == j {
                    8.0 + i as f64
                } else {
                    1.0 / (1 + i + j) as f64
                };
                matrix.add(i, j, value);
                (full[i][j], full[j][i]) = (value, value);
            }
            matrix.border[i] = 0.3 * i as f64;
            (full[i][size], full[size][i]) = (0.3 * i as f64, 0.3 * i as f64);
        }
        matrix.corner = 5.0;
        full[size][size] = 5.0;
        let want: Vec<f64> = (0..=size).map(|i| (i as f64).sin()).collect();
        let times = |x: &[f64]| -> Vec<f64> {
            let rows = full.iter();
            rows.map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum())
                .collect()
        };
        let mut found = times(&want);
        matrix.solve(&mut found).unwrap();
        for (found, want) in found.iter().zip(&want) {
            assert!((found - want).abs() < 1e-12, "{found} {want}");
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_is_refused() {
        let mut matrix = BorderedMatrix::default();
        matrix.clear(2);
        matrix.add(0, 0, 1.0);
        matrix.add(1, 1, -1.0);
        assert_eq!(matrix.solve(&mut [1.0, 1.0, 1.0]), None);
    }
}
