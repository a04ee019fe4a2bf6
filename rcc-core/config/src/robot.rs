//! A robot as its file describes it: kinematics and the limits of each joint, in SI units.
//! Read once at start-up by every process that works with the cell; never by the real-time thread.

use rcc_core::guard::JointLimits;
use rcc_core::impedance::ImpedanceLimits;
use rcc_core::kinematics::Arm;
use rcc_core::message::JOINTS_MAX;

mod read;

pub(crate) use read::robot as read;

/// An arm: kinematics and limits.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotConfig {
    /// What people call it.
    pub name: String,
    /// Kinematics.
    pub arm: Arm,
    /// One row a joint, from the base to the flange; never empty, at most [`JOINTS_MAX`].
    pub joints: Vec<JointConfig>,
    /// What impedance set-points may be; `None` = its controller has position control only.
    pub impedance: Option<ImpedanceLimits>,
    /// The file it was read from, as the cell's file names it.
    pub source: String,
}

/// What one joint may do.
#[derive(Clone, Debug, PartialEq)]
pub struct JointConfig {
    /// Name, unique in its robot.
    pub name: String,
    /// Smallest position, rad.
    pub lower_rad: f64,
    /// Largest position, rad; greater than the smallest.
    pub upper_rad: f64,
    /// Largest |velocity|, rad/s; greater than 0.
    pub velocity_rad_s: f64,
    /// Largest |acceleration|, rad/s²; greater than 0.
    pub acceleration_rad_s2: f64,
    /// Largest |jerk|, rad/s³; greater than 0.
    pub jerk_rad_s3: f64,
}

impl RobotConfig {
    /// The limits that the guard enforces; elements beyond the joints are 0.
    #[must_use]
    pub fn limits(&self) -> JointLimits {
        let column = |of: fn(&JointConfig) -> f64| {
            let mut values = [0.0; JOINTS_MAX];
            for (place, joint) in values.iter_mut().zip(&self.joints) {
                *place = of(joint);
            }
            values
        };
        JointLimits {
            lower: column(|joint| joint.lower_rad),
            upper: column(|joint| joint.upper_rad),
            velocity_max: column(|joint| joint.velocity_rad_s),
            acceleration_max: column(|joint| joint.acceleration_rad_s2),
            jerk_max: column(|joint| joint.jerk_rad_s3),
            joints: self.joints.len().min(JOINTS_MAX),
        }
    }
}

/// The limits of a device without joints.
pub(crate) const NO_JOINTS: JointLimits = JointLimits {
    lower: [0.0; JOINTS_MAX],
    upper: [0.0; JOINTS_MAX],
    velocity_max: [0.0; JOINTS_MAX],
    acceleration_max: [0.0; JOINTS_MAX],
    jerk_max: [0.0; JOINTS_MAX],
    joints: 0,
};
