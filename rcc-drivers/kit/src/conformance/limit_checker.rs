//! Checks the set-points that a device receives against the limits of its robot.
//! Test code only.

use rcc_core::message::Joints;

use crate::host::limits::ArmLimits;

/// Tolerance for the rounding of the wire: binary32 has a resolution of 2.4e-7 rad at 4 rad.
const ROUNDING_RAD: f64 = 2.4e-7;

/// Checker for one arm.
#[derive(Clone, Debug)]
pub struct LimitChecker {
    limits: ArmLimits,
    last: Option<ObservedMotion>,
    /// Descriptions of all violations.
    pub violations: Vec<String>,
}

#[derive(Clone, Copy, Debug)]
struct ObservedMotion {
    at_s: f64,
    position: Joints,
    /// Mean velocity up to this position and the interval of the mean; `None` for the first position.
    velocity: Option<(Joints, f64)>,
}

impl LimitChecker {
    /// A checker without any set-points yet.
    pub fn new(limits: ArmLimits) -> Self {
        Self {
            limits,
            last: None,
            violations: Vec::new(),
        }
    }

    /// Restarts the comparison: the device is not following at present.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Checks a position that the device follows at this time (s).
    pub fn observe(&mut self, at_s: f64, position: &Joints) {
        let joints = self.limits.joints.joints;
        let mut motion = ObservedMotion {
            at_s,
            position: *position,
            velocity: None,
        };
        if let Some(last) = self.last {
            let dt_s = at_s - last.at_s;
            let mut velocity = [0.0; rcc_core::message::JOINTS_MAX];
            for (joint, place) in velocity.iter_mut().enumerate().take(joints) {
                *place = (position[joint] - last.position[joint]) / dt_s;
            }
            motion.velocity = Some((velocity, dt_s));
        }
        for joint in 0..joints {
            self.check(joint, &motion);
        }
        self.last = Some(motion);
    }

    fn check(&mut self, joint: usize, motion: &ObservedMotion) {
        let limits = self.limits.joints;
        let q = motion.position[joint];
        let inside =
            q >= limits.lower[joint] - ROUNDING_RAD && q <= limits.upper[joint] + ROUNDING_RAD;
        // Also false for NaN.
        if !inside {
            self.report(joint, "position", q, motion);
        }
        let Some((velocity, dt_s)) = motion.velocity else {
            return;
        };
        let v = velocity[joint];
        let v_max = limits.velocity_max[joint] * 1.001 + 2.0 * ROUNDING_RAD / dt_s;
        let a_max = limits.acceleration_max[joint] * 1.05;
        if v.abs() > v_max {
            self.report(joint, "velocity", v, motion);
        }
        if let Some((before, dt_before_s)) = self.last.and_then(|last| last.velocity) {
            let between_s = 0.5 * (dt_s + dt_before_s);
            let a = (v - before[joint]) / between_s;
            if a.abs() > a_max + 4.0 * ROUNDING_RAD / (dt_s.min(dt_before_s) * between_s) {
                self.report(joint, "acceleration", a, motion);
            }
        }
    }

    fn report(&mut self, joint: usize, what: &str, value: f64, motion: &ObservedMotion) {
        let at_s = motion.at_s;
        self.violations.push(format!(
            "at {at_s:.3} s joint {}: {what} {value}",
            joint + 1
        ));
    }
}
