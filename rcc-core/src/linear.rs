//! Systems of linear equations up to 8×8: Gauss-Jordan elimination with partial pivoting. Golub, Van Loan: "Matrix
//! Computations", 4th edition, sections 3.2 and 3.4. Run by the real-time thread.

use crate::frame::Frame;
use crate::primitive::{Real, Slot};

/// Maximum number of rows of a square matrix.
pub const SIDE_MAX: usize = 8;

/// A square matrix augmented with columns at its right, `W` columns in total; rows beyond the matrix are empty.
pub struct AugmentedMatrix<const W: usize> {
    rows: [[f64; W]; SIDE_MAX],
    side: usize,
}

impl<const W: usize> AugmentedMatrix<W> {
    /// Reads a square matrix; `None` if it is too large, or if an element is null or infinite.
    pub fn read(frame: &Frame<'_>, slot: Slot<Real>, side: u32) -> Option<AugmentedMatrix<W>> {
        let count = side as usize;
        let mut rows = [[0.0; W]; SIDE_MAX];
        if count > SIDE_MAX || count > W {
            return None;
        }
        for (row, from) in rows.iter_mut().take(count).zip(0u32..) {
            for (place, column) in row.iter_mut().take(count).zip(0u32..) {
                *place = frame.get(slot + from * side + column)?;
                if !place.is_finite() {
                    return None;
                }
            }
        }
        Some(AugmentedMatrix { rows, side: count })
    }

    /// Sets the augmented columns: `value(row, column)` for each row and each augmented column, from 0.
    pub fn fill(&mut self, value: impl Fn(u32, u32) -> Option<f64>) -> Option<()> {
        for (row, number) in self.rows.iter_mut().take(self.side).zip(0u32..) {
            for (place, column) in row.iter_mut().skip(self.side).zip(0u32..) {
                *place = value(number, column)?;
            }
        }
        Some(())
    }

    /// Returns an element of the augmented columns, indexed as in [`AugmentedMatrix::fill`].
    pub fn get(&self, row: u32, column: u32) -> Option<f64> {
        let row = self.rows.get(row as usize)?;
        row.get(self.side + column as usize).copied()
    }

    /// Returns the pivot size at or below which a matrix counts as singular: the magnitude that rounding gives to a
    /// zero pivot.
    pub fn least_pivot(&self) -> f64 {
        let elements = self.rows.iter().flat_map(|row| row.iter().take(self.side));
        let largest = elements.fold(0.0, |largest: f64, value| largest.max(value.abs()));
        largest * f64::EPSILON * self.side as f64
    }

    /// Reduces the matrix to the identity and the augmented columns to the solution; returns the determinant, or `None`
    /// as soon as a pivot is not greater than `least`.
    pub fn reduce(&mut self, least: f64) -> Option<f64> {
        let mut determinant = 1.0;
        for column in 0..self.side {
            let size = |row: &[f64; W]| row.get(column).map_or(0.0, |value| value.abs());
            let candidates = self.rows.iter().take(self.side).enumerate().skip(column);
            let largest = candidates.fold((column, -1.0), |largest, (number, row)| {
                let size = size(row);
                if size > largest.1 {
                    (number, size)
                } else {
                    largest
                }
            });
            if largest.0 != column {
                // Both are less than `side`, which is at most SIDE_MAX.
                self.rows.swap(column, largest.0);
                determinant = -determinant;
            }
            let (above, rest) = self.rows.split_at_mut_checked(column)?;
            let (row, below) = rest.split_first_mut()?;
            let pivot = *row.get(column)?;
            if pivot.is_nan() || pivot.abs() <= least {
                return None;
            }
            determinant *= pivot;
            row.iter_mut().for_each(|value| *value /= pivot);
            for other in above.iter_mut().chain(below) {
                let factor = *other.get(column)?;
                for (place, value) in other.iter_mut().zip(row.iter()) {
                    *place -= factor * value;
                }
            }
        }
        Some(determinant)
    }
}
