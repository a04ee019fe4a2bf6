//! The ramp that brings a moving set-point to rest: straight in joint space, with bounded deceleration and jerk.
//! Pure; run by the clock thread.

use super::Joints;

/// A stop in progress: the velocity is `v0 · (1 − 3x² + 2x³)` with `x` = time / duration, equal for all joints.
///
/// It starts and ends with zero deceleration. An acceleration at the start of the stop is dropped at once; the arm's
/// own lag smooths this.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StopRamp {
    from: Joints,
    velocity: Joints,
    duration_s: f64,
    time_s: f64,
}

impl StopRamp {
    /// A stop from `position` (rad) and `velocity` (rad/s) within `deceleration` (rad/s²) and `jerk` (rad/s³).
    pub fn new(position: Joints, velocity: Joints, deceleration: f64, jerk: f64) -> Self {
        let fastest = velocity.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        Self {
            from: position,
            velocity,
            duration_s: (1.5 * fastest / deceleration).max((6.0 * fastest / jerk).sqrt()),
            time_s: 0.0,
        }
    }

    /// Advances by `step_s` seconds and returns the set-point, which stays constant after the end.
    pub fn advance(&mut self, step_s: f64) -> Joints {
        self.time_s = (self.time_s + step_s).min(self.duration_s);
        let x = if self.duration_s > 0.0 {
            self.time_s / self.duration_s
        } else {
            1.0
        };
        let way = self.duration_s * (x - x.powi(3) + 0.5 * x.powi(4));
        std::array::from_fn(|joint| self.from[joint] + self.velocity[joint] * way)
    }

    /// Returns true if the set-point has come to rest.
    pub fn is_at_rest(&self) -> bool {
        self.time_s >= self.duration_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stays_within_deceleration_and_jerk_and_ends_at_rest() {
        for speed in [0.01, 0.3, 2.0, 4.0] {
            let dt = 1e-3;
            let mut velocity = [0.0; 7];
            velocity[3] = -speed;
            let mut brake = StopRamp::new([0.1; 7], velocity, 8.0, 200.0);
            let (mut q, mut v, mut a) = (0.1, -speed, 0.0);
            let mut steps = 0;
            while !brake.is_at_rest() {
                let next = brake.advance(dt);
                let next_v = (next[3] - q) / dt;
                let next_a = (next_v - v) / dt;
                assert!(next_a.abs() <= 8.0 + 1e-6, "deceleration {next_a}");
                // The first finite difference spans only half a step.
                assert!(steps < 2 || ((next_a - a) / dt).abs() <= 200.0 * 1.01 + 1e-6);
                assert_eq!(next[0], 0.1);
                (q, v, a, steps) = (next[3], next_v, next_a, steps + 1);
            }
            assert_eq!(brake.advance(dt)[3], q);
            assert!(v.abs() < speed * 0.05 + 1e-6);
        }
    }

    #[test]
    fn a_stop_from_rest_is_over_at_once() {
        let mut brake = StopRamp::new([0.5; 7], [0.0; 7], 8.0, 200.0);
        assert!(brake.is_at_rest());
        assert_eq!(brake.advance(1e-3), [0.5; 7]);
    }
}
