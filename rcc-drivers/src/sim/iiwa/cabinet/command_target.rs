//! Set-point and added forces of one command in the overlay of the motion, checked against the robot's limits.
//! Pure; run by the clock thread.

use super::Cabinet;
use crate::fri_iiwa::wire::schema::{Command, CommandData, JointValues};
use crate::sim::arm::impedance::nearest_joints;
use crate::sim::arm::model::geometry;
use crate::sim::iiwa::fault::CabinetFault;
use crate::sim::iiwa::pose::{self, distances, lengths};
use crate::sim::iiwa::settings::{OverlayMode, Selector};
use crate::sim::iiwa::{JOINTS, Joints};

/// Largest difference of a pose while the robot synchronises, m and rad. The values are ours.
const POSE_TOLERANCE: (f64, f64) = (1e-3, 0.01);
/// Greatest speed of the flange in T1, m/s (ISO 10218-1).
const REDUCED_SPEED: f64 = 0.25;
/// E1 on the wire.
const REDUNDANCY_E1: i32 = 0;

impl Cabinet {
    /// Checks that the command repeats the interpolated position, or pose.
    pub(super) fn check_mirrored(&self, command: &Command) -> Result<(), CabinetFault> {
        if self.settings.overlay == OverlayMode::CartesianPose {
            let commanded = pose::from_wire(data(command).pose.as_ref().ok_or(NO_POSE)?)?;
            let own = geometry(self.settings.arm.model(), &self.interpolated);
            let (distance, angle) = distances(&own, &commanded);
            let is_near = distance <= POSE_TOLERANCE.0 && angle <= POSE_TOLERANCE.1;
            return match is_near {
                true => Ok(()),
                false => Err(CabinetFault::MirrorPose { distance, angle }),
            };
        }
        let position = seven("jointPosition", data(command).position.as_ref())?;
        let tolerance = self.settings.robot.mirror_tolerance_rad;
        for (joint, (value, own)) in position.into_iter().zip(self.interpolated).enumerate() {
            let distance = (value - own).abs();
            if distance.is_nan() || distance > tolerance {
                return Err(CabinetFault::Mirror {
                    joint,
                    value,
                    own,
                    tolerance,
                });
            }
        }
        Ok(())
    }

    /// Checks that what the overlay needs beside the position is there; its value does not count yet.
    pub(super) fn check_presence(&self, command: &Command) -> Result<(), CabinetFault> {
        let data = data(command);
        let missing = |field| Err(CabinetFault::Missing { field });
        match self.settings.overlay {
            OverlayMode::Wrench if data.wrench.is_none() => missing("cartesianWrenchFeedForward"),
            OverlayMode::Torque if data.torque.is_none() => missing("jointTorque"),
            _ => Ok(()),
        }
    }

    /// Returns the joint set-point of a command, rad.
    ///
    /// # Errors
    /// Returns a fault for a missing position, and for a pose that is invalid or that cannot be reached.
    pub(super) fn target(&self, command: &Command) -> Result<Joints, CabinetFault> {
        let data = data(command);
        if self.settings.overlay != OverlayMode::CartesianPose {
            return seven("jointPosition", data.position.as_ref());
        }
        let commanded = pose::from_wire(data.pose.as_ref().ok_or(NO_POSE)?)?;
        let model = self.settings.arm.model();
        let e1 = data
            .redundancy
            .filter(|redundancy| redundancy.strategy == Some(REDUNDANCY_E1))
            .and_then(|redundancy| redundancy.value);
        let last = self.last_target();
        let found = match e1 {
            Some(value) if !value.is_finite() => {
                return Err(CabinetFault::NotFinite {
                    field: "redundancyInformation",
                    element: 0,
                });
            }
            Some(value) => pose::joints_of(model, &last, &commanded, value),
            None => nearest_joints(model, &last, &commanded),
        };
        found.map_err(|left| {
            let (distance, angle) = lengths(left);
            CabinetFault::Unreachable { distance, angle }
        })
    }

    fn last_target(&self) -> Joints {
        match self.motion {
            super::Motion::Follow(commands) if commands.mirror_checked() => commands.target(),
            _ => self.interpolated,
        }
    }

    /// Returns what the command adds to the springs: joint torques, or a wrench in base axes.
    ///
    /// # Errors
    /// Returns a fault for a missing field, values that are not finite, and torques beyond the joints' limits, commanded or
    /// needed for the wrench.
    pub(super) fn added(&self, command: &Command) -> Result<Joints, CabinetFault> {
        let data = data(command);
        match self.settings.overlay {
            OverlayMode::Position | OverlayMode::CartesianPose => Ok([0.0; JOINTS]),
            OverlayMode::Torque => {
                let torques = seven("jointTorque", data.torque.as_ref())?;
                finite("jointTorque", &torques)?;
                self.check_torques(&torques)?;
                Ok(torques)
            }
            OverlayMode::Wrench => {
                let field = "cartesianWrenchFeedForward";
                let elements = data.wrench.as_ref().map(|wrench| wrench.element.as_slice());
                let elements = elements.and_then(|six| <[f64; 6]>::try_from(six).ok());
                let wrench = elements.ok_or(CabinetFault::Missing { field })?;
                finite(field, &wrench)?;
                // KUKA's order is x y z A B C, where A turns about z; the axes are those of the motion centre.
                let [x, y, z, a, b, c] = wrench;
                let rotation = &self.robot.geometry.rotation;
                let turned = |v: [f64; 3]| -> [f64; 3] {
                    std::array::from_fn(|row| (0..3).map(|i| rotation[row][i] * v[i]).sum())
                };
                let ([fx, fy, fz], [tx, ty, tz]) = (turned([x, y, z]), turned([c, b, a]));
                let torques = self.robot.geometry.joint_torque(&[fx, fy, fz, tx, ty, tz]);
                self.check_torques(&torques)?;
                Ok([fx, fy, fz, tx, ty, tz, 0.0])
            }
        }
    }

    fn check_torques(&self, torques: &Joints) -> Result<(), CabinetFault> {
        let limits = self.settings.arm.torques();
        let mut rows = torques.iter().zip(limits).enumerate();
        match rows.find(|(_, (value, limit))| value.abs() > *limit) {
            None => Ok(()),
            Some((joint, (&value, limit))) => Err(CabinetFault::Torque {
                joint,
                value,
                limit,
            }),
        }
    }

    /// Checks the speed of the flange in T1.
    pub(super) fn check_speed(
        &self,
        position: &Joints,
        velocity: &Joints,
    ) -> Result<(), CabinetFault> {
        if self.settings.selector != Selector::T1 {
            return Ok(());
        }
        let at = geometry(self.settings.arm.model(), position);
        let speed = at
            .flange_velocity(velocity)
            .iter()
            .map(|v| v * v)
            .sum::<f64>()
            .sqrt();
        match speed > REDUCED_SPEED {
            true => Err(CabinetFault::ReducedSpeed(speed)),
            false => Ok(()),
        }
    }
}

const NO_POSE: CabinetFault = CabinetFault::Missing {
    field: "cartesianPose",
};

/// A command of a header alone.
static NOTHING: CommandData = CommandData {
    position: None,
    wrench: None,
    torque: None,
    transformations: Vec::new(),
    io: Vec::new(),
    pose: None,
    redundancy: None,
};

fn data(command: &Command) -> &CommandData {
    command.data.as_ref().unwrap_or(&NOTHING)
}

fn seven(field: &'static str, values: Option<&JointValues>) -> Result<Joints, CabinetFault> {
    let values = values.and_then(|values| values.value.as_slice().try_into().ok());
    values.ok_or(CabinetFault::Missing { field })
}

fn finite(field: &'static str, values: &[f64]) -> Result<(), CabinetFault> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(element) => Err(CabinetFault::NotFinite { field, element }),
    }
}
