//! Motion of the simulated arm under position control: each joint follows its set-point like a critically damped oscillator.
//! Pure; run by the clock thread.
//!
//! There is no velocity feed-forward: at constant velocity `v` a joint lags `2 v / ω` behind (25 mrad at 1 rad/s with
//! 80 rad/s). All joints have the same bandwidth, so the lag lies along the path. The arm never overshoots.

use super::{JOINTS, Joints};

/// A joint is at rest below this velocity (rad/s) and this distance to its set-point (rad). The value is ours.
const REST: f64 = 1e-4;

/// State of the arm, and its extremes since the last reset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedArm {
    bandwidth: f64,
    /// rad.
    pub position: Joints,
    /// rad/s.
    pub velocity: Joints,
    /// rad/s².
    pub acceleration: Joints,
    /// Largest magnitude since the last reset, rad/s.
    pub velocity_max: Joints,
    /// Largest magnitude since the last reset, rad/s².
    pub acceleration_max: Joints,
    rests: bool,
}

impl SimulatedArm {
    /// An arm at rest at `position` (rad), with a bandwidth in rad/s.
    pub fn new(position: Joints, bandwidth: f64) -> Self {
        Self {
            bandwidth,
            position,
            velocity: [0.0; JOINTS],
            acceleration: [0.0; JOINTS],
            velocity_max: [0.0; JOINTS],
            acceleration_max: [0.0; JOINTS],
            rests: true,
        }
    }

    /// Follows a set-point that moves at constant velocity from `from` to `to` (rad) in `step_s` seconds.
    ///
    /// Exact for any step: `x = u(t) − 2r/ω + (e₀ + (ė₀ + ω e₀) t) e^(−ωt)` solves `ẍ = ω²(u − x) − 2ω ẋ` for `u(t) =
    /// u₀ + r t`.
    pub fn follow(&mut self, from: &Joints, to: &Joints, step_s: f64) {
        let w = self.bandwidth;
        let decay = (-w * step_s).exp();
        self.rests = true;
        for joint in 0..JOINTS {
            let rate = (to[joint] - from[joint]) / step_s;
            let lag = 2.0 * rate / w;
            let error = self.position[joint] - from[joint] + lag;
            let slope = self.velocity[joint] - rate + w * error;
            let rest = (error + slope * step_s) * decay;
            self.position[joint] = to[joint] - lag + rest;
            self.velocity[joint] = rate + slope * decay - w * rest;
            self.acceleration[joint] =
                w * w * (to[joint] - self.position[joint]) - 2.0 * w * self.velocity[joint];
            self.velocity_max[joint] = self.velocity_max[joint].max(self.velocity[joint].abs());
            self.acceleration_max[joint] =
                self.acceleration_max[joint].max(self.acceleration[joint].abs());
            self.rests &= rate == 0.0
                && self.velocity[joint].abs() < REST
                && (to[joint] - self.position[joint]).abs() < REST;
        }
    }

    /// Updates the extremes and the state of rest after a step with mean acceleration `acceleration` (rad/s²). The arm
    /// is at rest if its set-point `stands` and all joints are slower than `slow` (rad/s).
    pub(super) fn note(&mut self, acceleration: Joints, stands: bool, slow: f64) {
        self.acceleration = acceleration;
        self.rests = stands;
        for joint in 0..JOINTS {
            self.velocity_max[joint] = self.velocity_max[joint].max(self.velocity[joint].abs());
            self.acceleration_max[joint] =
                self.acceleration_max[joint].max(self.acceleration[joint].abs());
            self.rests &= self.velocity[joint].abs() < slow;
        }
    }

    /// Returns true if the set-point stood still in the last step and every joint has reached it.
    pub fn is_at_rest(&self) -> bool {
        self.rests
    }

    /// Resets the extremes.
    pub fn reset_extremes(&mut self) {
        self.velocity_max = [0.0; JOINTS];
        self.acceleration_max = [0.0; JOINTS];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(time_s: f64) -> Joints {
        [0.7 * time_s; JOINTS]
    }

    #[test]
    fn one_long_step_equals_many_short_ones() {
        let (mut long, mut short) = (
            SimulatedArm::new([0.0; 7], 80.0),
            SimulatedArm::new([0.0; 7], 80.0),
        );
        long.follow(&ramp(0.0), &ramp(0.05), 0.05);
        for i in 0..500 {
            let t = f64::from(i) * 1e-4;
            short.follow(&ramp(t), &ramp(t + 1e-4), 1e-4);
        }
        for joint in 0..JOINTS {
            assert!((long.position[joint] - short.position[joint]).abs() < 1e-12);
            assert!((long.velocity[joint] - short.velocity[joint]).abs() < 1e-10);
        }
    }

    #[test]
    fn lags_twice_the_velocity_over_the_bandwidth_behind() {
        let mut arm = SimulatedArm::new([0.0; 7], 80.0);
        arm.follow(&ramp(0.0), &ramp(2.0), 2.0);
        assert!((ramp(2.0)[0] - arm.position[0] - 2.0 * 0.7 / 80.0).abs() < 1e-12);
        assert!((arm.velocity[0] - 0.7).abs() < 1e-12);
        assert!(!arm.is_at_rest());
    }

    #[test]
    fn never_overshoots_and_comes_to_rest() {
        let mut arm = SimulatedArm::new([0.0; 7], 80.0);
        let goal = [1.0; JOINTS];
        arm.follow(&[0.0; 7], &goal, 1e-3);
        for _ in 0..1000 {
            arm.follow(&goal, &goal, 1e-3);
            assert!(arm.position[0] <= 1.0 + 1e-12);
        }
        assert!(arm.is_at_rest());
        assert!(arm.velocity_max[0] > 1.0);
        arm.reset_extremes();
        assert_eq!(arm.velocity_max, [0.0; 7]);
    }
}
