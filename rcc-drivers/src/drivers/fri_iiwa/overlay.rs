//! Contents of an answer in each overlay of the robot's motion: joint positions, a wrench, joint torques, or a pose.
//! Pure; run by the host's thread.
//!
//! FRI does not command stiffness and damping, they are the application's. A net that commands forces says which springs it
//! means, so the robot's file must have the application's springs as ranges of one value: then the guard refuses a net that
//! means others, and nothing that a net commands is ignored.
//!
//! A robot's file may describe the arm in a base and with a flange that are turned by 180° about z, so that the joints of an
//! iiwa turn as those of an LWR do. Poses and wrenches of the wire are in the robot's own frames.

use rcc_config::DeviceConfig;
use rcc_core::impedance::{ControlMode, ImpedanceLimits};
use rcc_core::kinematics::{Arm, SrsArm};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;

use super::robot_state::RobotState;
use crate::fri_iiwa::wire::schema::{
    CartesianVector, CommandData, JointValues, Redundancy, Transformation,
};
use crate::fri_iiwa::wire::{ClientCommandMode, JOINTS, SessionState};

/// Largest difference of a quaternion's length from 1.
const UNIT: f64 = 1e-3;
/// The redundancy value is the position of A3 in KUKA's strategy E1.
const E1: i32 = 0;
const REDUNDANT_JOINT: usize = 2;
/// Directions of the joints of an iiwa in its own base, and in one that is turned by 180° about z.
const OWN_SIGNS: [f64; JOINTS] = [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0];
const TURNED_SIGNS: [f64; JOINTS] = [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0];

/// Encodes answers for each overlay; knows the arm and the springs of its application.
#[derive(Clone, Debug)]
pub struct OverlayEncoder {
    /// The arm in the robot's own frames; `None`: the robot's file has other frames, and poses cannot be converted.
    arm: Option<Arm>,
    /// The robot's file has its base and flange turned.
    turned: bool,
    springs: Option<ImpedanceLimits>,
    /// Motion centre relative to the flange, from the robot's own pose; `None`: there is no valid pose.
    tool: Option<Pose>,
}

impl OverlayEncoder {
    /// Returns an encoder for the device's robot.
    #[must_use]
    pub fn of(device: &DeviceConfig) -> Self {
        let model = device.model();
        let described = match model.arm {
            Some(Arm::Srs(arm)) => Some(arm),
            _ => None,
        };
        let turned = described.is_some_and(|arm| arm.signs == TURNED_SIGNS);
        let own = described.filter(|arm| turned || arm.signs == OWN_SIGNS);
        Self {
            arm: own.map(|arm| {
                Arm::Srs(SrsArm {
                    signs: OWN_SIGNS,
                    ..arm
                })
            }),
            turned,
            springs: model.impedance,
            tool: None,
        }
    }

    /// Derives the motion centre from the interpolated position and its pose.
    pub fn observe(&mut self, robot: &RobotState) {
        let pose = robot.pose.as_ref().and_then(pose);
        self.tool = match (self.arm, robot.interpolated, pose) {
            (Some(arm), Some(position), Some(pose)) => {
                Some(arm.forward(&position).inverse().compose(&pose))
            }
            _ => None,
        };
    }

    /// Converts a wrench between the robot's own axes and those of the robot's file; in both directions the same.
    #[must_use]
    pub fn turn(&self, [fx, fy, fz, tx, ty, tz]: [f64; 6]) -> [f64; 6] {
        match self.turned {
            true => [-fx, -fy, fz, -tx, -ty, tz],
            false => [fx, fy, fz, tx, ty, tz],
        }
    }

    /// Returns the control mode in which a net commands the robot in this overlay; `None` if it cannot.
    #[must_use]
    pub fn mode(&self, robot: &RobotState) -> Option<ControlMode> {
        let mode = match ClientCommandMode::from_wire(robot.command_mode)? {
            ClientCommandMode::JointPosition => ControlMode::Position,
            ClientCommandMode::CartesianPose => {
                return self.tool.map(|_| ControlMode::Position);
            }
            ClientCommandMode::Wrench => ControlMode::CartesianImpedance,
            ClientCommandMode::Torque => ControlMode::JointImpedance,
            ClientCommandMode::None => return None,
        };
        (mode == ControlMode::Position || self.has_springs(mode)).then_some(mode)
    }

    /// Returns true in an overlay of forces if the robot's file does not say which springs the application has chosen.
    #[must_use]
    pub fn lacks_springs(&self, robot: &RobotState) -> bool {
        match ClientCommandMode::from_wire(robot.command_mode) {
            Some(ClientCommandMode::Wrench) => !self.has_springs(ControlMode::CartesianImpedance),
            Some(ClientCommandMode::Torque) => !self.has_springs(ControlMode::JointImpedance),
            _ => false,
        }
    }

    fn has_springs(&self, mode: ControlMode) -> bool {
        let Some(limits) = &self.springs else {
            return false;
        };
        (0..ImpedanceLimits::elements(mode, JOINTS)).all(|element| {
            let of = limits.of(mode, element);
            let [least, greatest] = of.stiffness;
            let [low, high] = of.damping;
            least == greatest && low == high
        })
    }

    /// Fills in what the overlay wants for these joint positions (rad) and added forces (N, N·m).
    pub fn fill(
        &self,
        robot: &RobotState,
        (position, added): (&Joints, &Joints),
        data: &mut CommandData,
    ) {
        data.position = Some(values(position));
        if robot.session < SessionState::CommandingWait {
            return;
        }
        match ClientCommandMode::from_wire(robot.command_mode) {
            Some(ClientCommandMode::Wrench) => {
                let [x, y, z, rx, ry, rz, ..] = *added;
                let [x, y, z, rx, ry, rz] = self.turn([x, y, z, rx, ry, rz]);
                data.wrench = Some(CartesianVector {
                    element: vec![x, y, z, rz, ry, rx],
                });
            }
            Some(ClientCommandMode::Torque) => data.torque = Some(values(added)),
            Some(ClientCommandMode::CartesianPose) => {
                data.position = None;
                (data.pose, data.redundancy) = self.pose(robot, position);
            }
            _ => {}
        }
    }

    /// Returns the pose of the motion centre and the redundancy for these joint positions; where the robot holds the joints
    /// itself, its own.
    fn pose(
        &self,
        robot: &RobotState,
        position: &Joints,
    ) -> (Option<Transformation>, Option<Redundancy>) {
        let own = robot.interpolated.as_ref() == Some(position);
        let (Some(arm), Some(tool), false) = (self.arm, self.tool, own) else {
            return (robot.pose.clone(), robot.redundancy);
        };
        let Pose {
            position: place,
            orientation: [i, j, k, w],
        } = arm.forward(position).compose(&tool);
        let [x, y, z] = place.map(|metres| metres * 1e3);
        let name = robot.pose.as_ref().and_then(|pose| pose.name.clone());
        let pose = Transformation {
            name,
            element: vec![x, y, z, w, i, j, k],
            timestamp: None,
        };
        let redundancy = robot.redundancy.map(|own| match own.strategy {
            Some(E1) => Redundancy {
                value: position.get(REDUNDANT_JOINT).copied(),
                ..own
            },
            _ => own,
        });
        (Some(pose), redundancy)
    }
}

/// Reads x, y, z (mm) and w, x, y, z; `None` if the values do not form a pose.
fn pose(wire: &Transformation) -> Option<Pose> {
    let [x, y, z, w, i, j, k] = <[f64; 7]>::try_from(wire.element.as_slice()).ok()?;
    let length = (w * w + i * i + j * j + k * k).sqrt();
    let pose = Pose {
        position: [x, y, z].map(|millimetres| millimetres * 1e-3),
        orientation: [i, j, k, w].map(|part| part / length),
    };
    ((length - 1.0).abs() <= UNIT && pose.is_finite()).then_some(pose)
}

fn values(joints: &Joints) -> JointValues {
    JointValues {
        value: joints.iter().take(JOINTS).copied().collect(),
    }
}
