//! A robot as described by its file: kinematics and the limits of each joint, in SI units. Read once at start-up by
//! every process that works with the cell; never by the real-time thread.

use rcc_core::guard::JointLimits;
use rcc_core::impedance::ImpedanceLimits;
use rcc_core::kinematics::Arm;
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::unit::Unit;

use crate::diagnostic::Faults;
use crate::file::SourceFile;

mod dynamics;
mod read;

pub use dynamics::LinkDynamics;
#[cfg(test)]
pub(crate) use read::keys;
pub(crate) use read::robot as read;

/// An arm: kinematics and limits.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotConfig {
    /// Name for people.
    pub name: String,
    /// Kinematics.
    pub arm: Arm,
    /// Joints from the base to the flange; at least one, at most [`JOINTS_MAX`].
    pub joints: Vec<JointConfig>,
    /// Limits of impedance set-points; `None` if its controller has position control only.
    pub impedance: Option<ImpedanceLimits>,
    /// Mass and friction of each joint's link, for simulators; empty if the file has none.
    pub dynamics: Vec<LinkDynamics>,
    /// Path of the file, as written in the cell's file.
    pub source: String,
}

/// Limits of one joint; those of a linear axis are in m instead of rad.
#[derive(Clone, Debug, PartialEq)]
pub struct JointConfig {
    /// Name, unique in its robot.
    pub name: String,
    /// Minimum position, rad.
    pub lower_rad: f64,
    /// Maximum position, rad; greater than the minimum.
    pub upper_rad: f64,
    /// Maximum |velocity|, rad/s; greater than 0.
    pub velocity_rad_s: f64,
    /// Maximum |acceleration|, rad/s²; greater than 0.
    pub acceleration_rad_s2: f64,
    /// Maximum |jerk|, rad/s³; greater than 0.
    pub jerk_rad_s3: f64,
}

impl RobotConfig {
    /// Parses the text of a robot's file; `file` is its name in diagnostics.
    ///
    /// # Errors
    /// Returns all faults of the text.
    pub fn parse(text: &str, file: &str) -> Result<RobotConfig, Faults> {
        let source = SourceFile {
            name: file.to_owned(),
            text: text.to_owned(),
        };
        let (root, mut reader) = crate::file::tree(&source)?;
        let robot = read(&mut reader, &root, file);
        source.faults(reader)?;
        // A reader that returns no robot has reported a fault. An empty list is still a refusal.
        robot.ok_or_else(|| Faults::new(file, text, Vec::new()))
    }

    /// Returns the limits that the guard enforces; elements beyond the joints are 0.
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

    /// Returns each joint at 0, or at the nearest end of its range, rad.
    #[must_use]
    pub fn nearest_to_zero(&self) -> Joints {
        let mut joints = [0.0; JOINTS_MAX];
        for (place, joint) in joints.iter_mut().zip(&self.joints) {
            *place = 0.0_f64.max(joint.lower_rad).min(joint.upper_rad);
        }
        joints
    }

    /// Parses joint positions from a setting such as `[0, "-30 deg", 0.5]`; returns them in rad (linear axes: m), or `None` unless there
    /// is one for each joint, inside its range.
    #[must_use]
    pub fn positions(&self, setting: &serde_json::Value) -> Option<Joints> {
        let given = setting.as_array()?;
        let mut joints = [0.0; JOINTS_MAX];
        if given.len() != self.joints.len() {
            return None;
        }
        for ((place, joint), value) in joints.iter_mut().zip(&self.joints).zip(given) {
            let unit = Unit::of_joints(self.arm.is_linear(), 0);
            let position = value.as_f64().or_else(|| quantity(value.as_str()?, unit))?;
            let inside = position >= joint.lower_rad && position <= joint.upper_rad;
            *place = inside.then_some(position)?;
        }
        Some(joints)
    }
}

/// Parses a quantity such as `-30 deg` in SI units; `None` in another unit.
fn quantity(text: &str, wanted: Unit) -> Option<f64> {
    let (number, unit) = text.trim().split_once(' ')?;
    let (unit, factor) = Unit::parse(unit.trim())?;
    let number: f64 = number.parse().ok()?;
    (unit == wanted).then_some(number * factor)
}

/// Limits of a device without joints.
pub(crate) const NO_JOINTS: JointLimits = JointLimits {
    lower: [0.0; JOINTS_MAX],
    upper: [0.0; JOINTS_MAX],
    velocity_max: [0.0; JOINTS_MAX],
    acceleration_max: [0.0; JOINTS_MAX],
    jerk_max: [0.0; JOINTS_MAX],
    joints: 0,
};
