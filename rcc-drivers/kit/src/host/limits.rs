//! The limits of an arm, from its robot's configuration.
//! Plain data, read by the host's thread.

use rcc_config::DeviceConfig;
use rcc_core::guard::JointLimits;
use rcc_core::impedance::ImpedanceLimits;
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_motion::StopLimits;

/// The limits of an arm; elements beyond its joints are 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmLimits {
    /// Limits that the guard enforces.
    pub joints: JointLimits,
    /// Largest |jerk|, rad/s³.
    pub jerk_max: Joints,
    /// Limits of impedance set-points; `None`: the arm is commanded in position only.
    pub impedance: Option<ImpedanceLimits>,
}

impl ArmLimits {
    /// Returns the limits of a device's robot; plain I/O has limits of zero joints.
    #[must_use]
    pub fn of(device: &DeviceConfig) -> Self {
        let mut jerk_max = [0.0; JOINTS_MAX];
        let joints = device.robot.iter().flat_map(|robot| &robot.joints);
        for (place, joint) in jerk_max.iter_mut().zip(joints) {
            *place = joint.jerk_rad_s3;
        }
        Self {
            joints: device.model().limits,
            jerk_max,
            impedance: device.model().impedance,
        }
    }

    /// Returns the limits of a stop.
    #[must_use]
    pub fn rest(&self) -> StopLimits {
        StopLimits {
            velocity_max: self.joints.velocity_max,
            acceleration_max: self.joints.acceleration_max,
            jerk_max: self.jerk_max,
            joints: self.joints.joints,
        }
    }
}
