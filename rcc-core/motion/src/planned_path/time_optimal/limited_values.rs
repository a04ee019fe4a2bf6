//! The values that a time law must keep within limits, with their derivatives. Used when a motion is built.

use super::section_table::{LimitedQuantity, Slopes};

/// The part of the limits that the clock of a law may use to slow down at any time: its greatest acceleration (per
/// s²) and jerk (per s³). Both 0: nothing is reserved.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct ClockReserve {
    pub(super) acceleration: f64,
    pub(super) jerk: f64,
}

impl ClockReserve {
    /// This part of the reserve.
    pub(super) fn times(self, part: f64) -> Self {
        Self {
            acceleration: self.acceleration * part,
            jerk: self.jerk * part,
        }
    }

    /// The reserve for a law that is `speed` times as fast.
    pub(super) fn at_speed(self, speed: f64) -> Self {
        Self {
            acceleration: self.acceleration * speed * speed,
            jerk: self.jerk * speed * speed * speed,
        }
    }
}

/// A limited value: the sum of velocity, acceleration and jerk of a quantity with these weights.
#[derive(Debug, Clone, Copy)]
struct LimitedValue {
    /// 0: velocity limit, 1: acceleration limit, 2: jerk limit.
    order: usize,
    weights: [f64; 3],
}

/// The limited values with the same signs of s'' and s'''.
struct SignedValues {
    signs: [f64; 2],
    values: Vec<LimitedValue>,
}

/// The limited values of joints and of magnitudes.
pub(super) struct LimitedValues {
    joints: Vec<SignedValues>,
    magnitudes: Vec<SignedValues>,
}

impl LimitedValues {
    pub(super) fn new(reserve: ClockReserve) -> Self {
        const BOTH: [f64; 2] = [1.0, -1.0];
        let ClockReserve { acceleration, jerk } = reserve;
        let velocity = LimitedValue {
            order: 0,
            weights: [1.0, 0.0, 0.0],
        };
        let second = |sign: f64| LimitedValue {
            order: 1,
            weights: [sign * acceleration, 1.0, 0.0],
        };
        let third = |sign: f64, second: f64| LimitedValue {
            order: 2,
            weights: [second * jerk, sign * 3.0 * acceleration, 1.0],
        };
        let mut of_joints = vec![velocity];
        let reserved = reserve != ClockReserve::default();
        for sign in BOTH.into_iter().take(if reserved { 2 } else { 1 }) {
            of_joints.push(second(sign));
            let seconds = BOTH.into_iter().take(if reserved { 2 } else { 1 });
            of_joints.extend(seconds.map(|second| third(sign, second)));
        }
        // The signs of magnitudes are unknown: their worst sum.
        let mut magnitudes = Vec::new();
        for a in BOTH {
            for j in BOTH {
                let mut values = vec![third(1.0, 1.0)];
                if j > 0.0 {
                    values.push(second(1.0));
                }
                if j > 0.0 && a > 0.0 {
                    values.push(velocity);
                }
                magnitudes.push(SignedValues {
                    signs: [a, j],
                    values,
                });
            }
        }
        Self {
            joints: vec![SignedValues {
                signs: [1.0; 2],
                values: of_joints,
            }],
            magnitudes,
        }
    }

    /// Number of limited values of a joint.
    pub(super) fn of_joint(&self) -> usize {
        self.joints.iter().map(|signed| signed.values.len()).sum()
    }

    /// Calls `each` for the limited values of one quantity with limits of order `least` or higher.
    pub(super) fn of_quantity(
        &self,
        limited: &LimitedQuantity,
        [f1, f2, f3, f4]: Slopes,
        ([_, v, a, j], decay): ([f64; 4], [f64; 3]),
        least: usize,
        each: &mut impl FnMut(&Fraction),
    ) {
        let signed = match limited.is_magnitude() {
            true => &self.magnitudes,
            false => &self.joints,
        };
        for SignedValues { signs, values } in signed {
            let [sign_a, sign_j] = *signs;
            let (a, j) = (sign_a * a, sign_j * j);
            let y = [
                f1 * v * decay[0],
                (f2 * v * v + f1 * a) * decay[1],
                (f3 * v * v * v + 3.0 * f2 * v * a + f1 * j) * decay[2],
            ];
            let by_state = [
                [f2 * v, f1, 0.0, 0.0],
                [f3 * v * v + f2 * a, 2.0 * f2 * v, f1 * sign_a, 0.0],
                [
                    f4 * v * v * v + 3.0 * f3 * v * a + f2 * j,
                    3.0 * (f3 * v * v + f2 * a),
                    3.0 * f2 * v * sign_a,
                    f1 * sign_j,
                ],
            ];
            for LimitedValue { order, weights } in values {
                let over = limited.over[*order];
                if over == 0.0 || *order < least {
                    continue;
                }
                let [w1, w2, w3] = weights.map(|weight| weight * over);
                let parts = [w1 * y[0], w2 * y[1], w3 * y[2]];
                let (w1, w2, w3) = (w1 * decay[0], w2 * decay[1], w3 * decay[2]);
                each(&Fraction {
                    order: *order,
                    value: parts[0] + parts[1] + parts[2],
                    slopes: core::array::from_fn(|by| {
                        w1 * by_state[0][by] + w2 * by_state[1][by] + w3 * by_state[2][by]
                    }),
                    by_theta: [
                        -(parts[0] + 2.0 * parts[1] + 3.0 * parts[2]),
                        parts[0] + 4.0 * parts[1] + 9.0 * parts[2],
                    ],
                });
            }
        }
    }
}

/// A value as a fraction of its limit, with its derivatives.
pub(super) struct Fraction {
    /// 0: velocity limit, 1: acceleration limit, 2: jerk limit.
    pub(super) order: usize,
    pub(super) value: f64,
    /// By s and its first three derivatives by u.
    pub(super) slopes: [f64; 4],
    /// First and second derivative by θ.
    pub(super) by_theta: [f64; 2],
}
