//! Checks set-points against the robot's limits, with arithmetic of its own: finite, range, velocity, acceleration. Run
//! by the thread of the target.

use rcc_core::guard::JointLimits;
use rcc_core::message::{JOINTS_MAX, Joints};

/// Relative tolerance for rounding and for the guard's own tolerance.
const TOLERANCE: f64 = 2e-3;

/// The set-points sent to a device, as far as the next check depends on them.
#[derive(Clone, Copy, Debug)]
pub struct SetPointChecker {
    limits: JointLimits,
    last: Option<(Joints, Option<(Joints, f64)>)>,
    /// Rounding error of a transmitted position, rad: that of binary32 on the wire, 0 in memory.
    rounding: f64,
}

impl SetPointChecker {
    /// Creates a checker for a device that has received no set-point yet.
    #[must_use]
    pub fn new(limits: JointLimits, rounding: f64) -> SetPointChecker {
        SetPointChecker {
            limits,
            last: None,
            rounding,
        }
    }

    /// Marks the device as not commanded: the next set-point is a first one.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Checks the first set-point of a motion from `hold`.
    ///
    /// # Panics
    /// Panics if it is further than `tolerance` from `hold`, or out of range.
    pub fn begin(&mut self, hold: &Joints, tolerance: f64, asked: &Joints) {
        self.in_range(asked);
        for joint in 0..self.limits.joints {
            let jump = (asked[joint] - hold[joint]).abs();
            assert!(
                jump <= tolerance + self.rounding + 1e-9,
                "joint {joint} jumps by {jump} rad"
            );
        }
        self.last = Some((*asked, None));
    }

    /// Marks the device as at rest at this position, wherever it is.
    pub fn rests(&mut self, at: &Joints) {
        self.last = Some((*at, None));
    }

    /// Checks that a set-point is within the range.
    ///
    /// # Panics
    /// Panics if it is not, or is not a number.
    pub fn in_range(&self, asked: &Joints) {
        let slack = self.rounding + 1e-8;
        for (joint, &q) in asked.iter().enumerate().take(self.limits.joints) {
            let inside =
                q >= self.limits.lower[joint] - slack && q <= self.limits.upper[joint] + slack;
            assert!(inside, "joint {joint} at {q} rad is out of its range");
        }
    }

    /// Checks a further set-point, `dt_s` of the device's time after the last one.
    ///
    /// # Panics
    /// Panics if it is not a number, or exceeds the limits of velocity or acceleration.
    pub fn follow(&mut self, asked: &Joints, dt_s: f64) {
        let Some((last, before)) = self.last else {
            return self.rests(asked);
        };
        let mut velocity = [0.0; JOINTS_MAX];
        for joint in 0..self.limits.joints {
            assert!(asked[joint].is_finite(), "joint {joint}: {}", asked[joint]);
            velocity[joint] = (asked[joint] - last[joint]) / dt_s;
            let (v_max, a_max) = (
                self.limits.velocity_max[joint],
                self.limits.acceleration_max[joint],
            );
            let rounding = 2.0 * self.rounding / dt_s;
            let v = velocity[joint].abs();
            assert!(
                v <= v_max * (1.0 + TOLERANCE) + rounding,
                "joint {joint}: {v} rad/s, {v_max} are allowed"
            );
            let (v_before, between_s) = match before {
                Some((velocity, dt_before)) => (velocity[joint], 0.5 * (dt_s + dt_before)),
                None => (0.0, dt_s),
            };
            let a = ((velocity[joint] - v_before) / between_s).abs();
            let excused = 2.0 * rounding / between_s;
            assert!(
                a <= a_max * (1.0 + TOLERANCE) + excused,
                "joint {joint}: {a} rad/s², {a_max} are allowed"
            );
        }
        self.last = Some((*asked, Some((velocity, dt_s))));
    }
}
