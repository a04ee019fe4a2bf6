//! The barrier at one sample of a time law, and how it depends on the coefficients of the law. Used when a motion is built.

use super::banded::BorderedMatrix;
use super::law_spline::{ACTIVE, Basis};
use super::limited_values::Fraction;

/// Gradient and Hessian of the barrier at one sample, by s, its first three derivatives by u, and θ.
#[derive(Default)]
pub(super) struct LocalModel {
    pub(super) gradient: [f64; 5],
    pub(super) hessian: [[f64; 5]; 5],
}

impl LocalModel {
    pub(super) fn add(&mut self, fraction: &Fraction, mu: f64) {
        let g = fraction.value;
        let left = 1.0 - g * g;
        let first = mu * 2.0 * g / left;
        let second = mu * 2.0 * (1.0 + g * g) / (left * left);
        let [a, b, c, d] = fraction.slopes;
        let [by_theta, bend] = fraction.by_theta;
        let slopes = [a, b, c, d, by_theta];
        for (row, slope) in slopes.iter().enumerate() {
            self.gradient[row] += first * slope;
            for (element, other) in self.hessian[row].iter_mut().zip(&slopes[..=row]) {
                *element += second * slope * other;
            }
        }
        self.hessian[4][4] += (first * bend).max(0.0);
    }
}

/// Index among the free coefficients.
pub(super) fn free_index(index: usize, free: usize) -> Option<usize> {
    index.checked_sub(3).filter(|index| *index < free)
}

/// Adds the derivatives at one sample to those by the coefficients.
pub(super) fn scatter(
    local: &LocalModel,
    basis: &Basis,
    interval: usize,
    (matrix, gradient): (&mut BorderedMatrix, &mut [f64]),
) {
    let free = gradient.len() - 1;
    let element = |row: usize, column: usize| match row >= column {
        true => local.hessian[row][column],
        false => local.hessian[column][row],
    };
    for i in 0..ACTIVE {
        let Some(row) = free_index(interval + i, free) else {
            continue;
        };
        let weights: [f64; 4] = core::array::from_fn(|order| basis[order][i]);
        let product = |column: usize| -> f64 {
            (0..4)
                .map(|order| weights[order] * element(order, column))
                .sum()
        };
        let slopes = weights.iter().zip(local.gradient);
        gradient[row] += slopes.map(|(weight, slope)| weight * slope).sum::<f64>();
        matrix.border[row] += product(4);
        let products: [f64; 4] = core::array::from_fn(product);
        let columns = (0..=i).filter_map(|j| Some((j, free_index(interval + j, free)?)));
        for (j, column) in columns {
            let sum = (0..4).map(|order| products[order] * basis[order][j]).sum();
            matrix.add(row, column, sum);
        }
    }
}
