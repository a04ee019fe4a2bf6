//! Joint set-point and impedance of one command: which fields its flags select, and whether they fit together.
//! Pure; run by the clock thread.
//!
//! A KRC reads a field only if its flag is set. Without a position the controller's own one holds, without a stiffness or
//! a damping the values of `$STIFFNESS` apply, and no force is added unless one is selected.

use super::Krc;
use crate::fri_lwr::wire::{CommandDatagram, flags};
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings, deflection, nearest_joints};
use crate::sim::arm::model::Geometry;
use crate::sim::lwr::fault::{KrcFault, MirrorError};
use crate::sim::lwr::model::{LWR_4_PLUS, geometry, geometry_of};
use crate::sim::lwr::{JOINTS, Joints};

/// Largest added force or torque at the entry into command state, N or N·m: users report that a real controller refuses
/// more than 1 N·m.
const ENTRY_ADDED_MAX: f64 = 1.0;
/// Tolerance between the commanded pose and that of the commanded joint positions, m and rad. The values are ours.
const POSE_TOLERANCE: (f64, f64) = (1e-3, 0.01);
/// Tolerance of a commanded rotation's columns against orthonormality. The value is ours.
const ORTHONORMAL: f64 = 1e-3;

impl Krc {
    /// Returns true if a KRC can execute a command with these flags: any of those that its strategy reads. In position
    /// control that is one; in impedance control there may be none, and the controller's own springs hold the arm.
    pub(in crate::sim::lwr) fn reads(&self, flags: u32) -> bool {
        let strategy = self.settings.strategy;
        let enough = flags != 0 || strategy != ControlLaw::Position;
        enough && flags & !strategy.flags() == 0
    }

    /// Returns how the command's position differs from the controller's own, if it does.
    pub(in crate::sim::lwr) fn not_mirrored(
        &self,
        command: &CommandDatagram,
    ) -> Option<MirrorError> {
        let values = command.joint_position.map(f64::from);
        let tolerance = self.settings.robot.mirror_tolerance_rad;
        let is_off = |joint: &usize| {
            let distance = (values[*joint] - self.robot.desired[*joint]).abs();
            distance.is_nan() || distance > tolerance
        };
        let joint_selected = command.flags & flags::JOINT_POSITION != 0;
        if let Some(joint) = (0..JOINTS).find(|joint| joint_selected && is_off(joint)) {
            return Some(MirrorError::Joint {
                joint,
                value: values[joint],
                own: self.robot.desired[joint],
                tolerance,
            });
        }
        let pose_selected = command.flags & flags::CARTESIAN_POSITION != 0;
        let commanded = geometry_of(&command.cartesian_position);
        let (distance, angle) = distances(&geometry(&self.robot.desired), &commanded);
        (pose_selected && !is_near(distance, angle))
            .then_some(MirrorError::Pose { distance, angle })
    }

    /// Returns the joint set-point of a command, rad.
    ///
    /// # Errors
    /// Returns a fault for a pose that is invalid, that does not match the joint positions, or that cannot be reached.
    pub(super) fn target(&self, command: &CommandDatagram) -> Result<Joints, KrcFault> {
        let selected = |flag| command.flags & flag != 0;
        let joints = command.joint_position.map(f64::from);
        if !selected(flags::CARTESIAN_POSITION) {
            return Ok(if selected(flags::JOINT_POSITION) {
                joints
            } else {
                self.robot.desired
            });
        }
        let commanded = geometry_of(&command.cartesian_position);
        if !is_rotation(&commanded) {
            return Err(KrcFault::Rotation);
        }
        if !selected(flags::JOINT_POSITION) {
            return nearest_joints(&LWR_4_PLUS, &self.robot.desired, &commanded).map_err(|left| {
                let (distance, angle) = lengths(left);
                KrcFault::Unreachable { distance, angle }
            });
        }
        let (distance, angle) = distances(&geometry(&joints), &commanded);
        if is_near(distance, angle) {
            Ok(joints)
        } else {
            Err(KrcFault::Pose { distance, angle })
        }
    }

    /// Returns the impedance of a command; `is_first` for the first command after the entry into command state.
    ///
    /// # Errors
    /// Returns a fault for a value out of range, or an added force at the entry.
    pub(super) fn impedance_of(
        &self,
        command: &CommandDatagram,
        is_first: bool,
    ) -> Result<ImpedanceSettings, KrcFault> {
        if self.settings.strategy == ControlLaw::Position {
            return Ok(self.robot.impedance);
        }
        let impedance = ImpedanceSettings::of(command, self.settings.strategy)?;
        let added = impedance.added.iter();
        let value = added.fold(0.0_f64, |most, value| most.max(value.abs()));
        if is_first && value > ENTRY_ADDED_MAX {
            return Err(KrcFault::Added { value });
        }
        Ok(impedance)
    }
}

/// Returns the distance (m) and the angle (rad) between two poses.
fn distances(one: &Geometry, other: &Geometry) -> (f64, f64) {
    lengths(deflection(one, other))
}

fn lengths([x, y, z, rx, ry, rz]: [f64; 6]) -> (f64, f64) {
    let length = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    (length([x, y, z]), length([rx, ry, rz]))
}

/// False for NaN.
fn is_near(distance: f64, angle: f64) -> bool {
    let (most, turn) = POSE_TOLERANCE;
    distance <= most && angle <= turn
}

fn is_rotation(pose: &Geometry) -> bool {
    let column = |index: usize| pose.rotation.map(|row| row[index]);
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
    let is_unit = |a: usize, b: usize| {
        let wanted = f64::from(u8::from(a == b));
        (dot(column(a), column(b)) - wanted).abs() <= ORTHONORMAL
    };
    let [x, y, z] = [column(0), column(1), column(2)];
    let normal = [
        x[1] * y[2] - x[2] * y[1],
        x[2] * y[0] - x[0] * y[2],
        x[0] * y[1] - x[1] * y[0],
    ];
    (0..3).all(|a| (0..3).all(|b| is_unit(a, b))) && dot(normal, z) > 0.0
}
