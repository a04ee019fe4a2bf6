//! Derivatives of joints that are sampled at equidistant steps along a path. Used when a motion is built.
//!
//! Each derivative uses seven samples around the position, at the ends those of one side: of fourth order in the step
//! or better. Weights by Fornberg, "Generation of finite difference formulas on arbitrarily spaced grids", Math. Comp.
//! 51 (1988), 699-706.

use rcc_core::message::{JOINTS_MAX, Joints};

use crate::geometry::jet::Jet;

/// Samples that each derivative uses.
pub(crate) const NEIGHBOURS: usize = 7;

/// Precision of joints from inverse kinematics, rad. Second and third derivatives are reduced towards 0 by its effect.
/// This matters only on paths so short that the permitted speed makes the difference irrelevant.
pub(crate) const ROUNDING: f64 = 1e-14;

/// Weights of the samples for the value and the first three derivatives at one of the samples, for a step of 1.
type Weights = [[f64; 4]; NEIGHBOURS];

/// The weights at sample `at` of [`NEIGHBOURS`].
fn weights(at: usize) -> Weights {
    let place = |index: usize| index as f64 - at as f64;
    let mut weights = [[0.0; 4]; NEIGHBOURS];
    weights[0][0] = 1.0;
    let (mut c1, mut c4) = (1.0, place(0));
    for i in 1..NEIGHBOURS {
        let highest = i.min(3);
        let (mut c2, c5) = (1.0, c4);
        c4 = place(i);
        for j in 0..i {
            let c3 = place(i) - place(j);
            c2 *= c3;
            if j == i - 1 {
                for k in (0..=highest).rev() {
                    let lower = if k > 0 {
                        k as f64 * weights[i - 1][k - 1]
                    } else {
                        0.0
                    };
                    weights[i][k] = c1 * (lower - c5 * weights[i - 1][k]) / c2;
                }
            }
            for k in (0..=highest).rev() {
                let lower = if k > 0 {
                    k as f64 * weights[j][k - 1]
                } else {
                    0.0
                };
                weights[j][k] = (c4 * weights[j][k] - lower) / c3;
            }
        }
        c1 = c2;
    }
    weights
}

/// The joints with their derivatives at each of the samples, which are `step` apart in s; empty for fewer than
/// [`NEIGHBOURS`] samples.
pub(crate) fn derivatives(samples: &[Joints], step: f64) -> Vec<[Jet; JOINTS_MAX]> {
    if samples.len() < NEIGHBOURS {
        return Vec::new();
    }
    let all: [Weights; NEIGHBOURS] = core::array::from_fn(weights);
    let jet = |number: usize| {
        let first = number
            .saturating_sub(NEIGHBOURS / 2)
            .min(samples.len() - NEIGHBOURS);
        let near = samples.iter().skip(first).take(NEIGHBOURS);
        let mut jets = [[0.0; 4]; JOINTS_MAX];
        for (sample, weights) in near.zip(&all[number - first]) {
            for (jet, joint) in jets.iter_mut().zip(sample) {
                for (derivative, weight) in jet.iter_mut().zip(weights) {
                    *derivative += weight * joint;
                }
            }
        }
        let rounding = |order: usize| {
            let weights = all[number - first].iter().map(|row| row[order].abs());
            ROUNDING * weights.sum::<f64>()
        };
        let rounding = [2, 3].map(rounding);
        let exact = |value: f64, rounding: f64| value.signum() * (value.abs() - rounding).max(0.0);
        jets.map(|[value, first, second, third]| {
            let second = exact(second, rounding[0]) / (step * step);
            let third = exact(third, rounding[1]) / (step * step * step);
            Jet([value, first / step, second, third])
        })
    };
    (0..samples.len()).map(jet).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_a_sine_are_right_at_every_sample() {
        let step = 0.01;
        let at = |number: usize| number as f64 * step;
        let samples: Vec<Joints> = (0..100)
            .map(|number| core::array::from_fn(|joint| (at(number) + joint as f64).sin()))
            .collect();
        for (number, jets) in derivatives(&samples, step).iter().enumerate() {
            for (joint, jet) in jets.iter().enumerate() {
                let x = at(number) + joint as f64;
                for (order, want) in [x.sin(), x.cos(), -x.sin(), -x.cos()].iter().enumerate() {
                    let error = (jet.derivative(order) - want).abs();
                    assert!(
                        error < [1e-15, 1e-11, 2e-8, 1e-5][order],
                        "{number} {order} {error}"
                    );
                }
            }
        }
    }
}
