//! Fields of an answer that depend on the control strategy: command flags, Cartesian pose, stiffness, damping, forces.
//! Pure; run by the host's thread.
//!
//! The flags may change in monitor state only. They therefore follow from the strategy that the controller runs, and
//! every field that they select is filled in from the first answer on. In Cartesian impedance control the pose is
//! commanded, together with the joint positions, which fix the redundancy; a KRC accepts these from software 5.6 on.

use rcc_config::DeviceConfig;
use rcc_core::impedance::{ControlMode, Impedance, ImpedanceLimits};
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::pose::Pose;

use crate::fri_lwr::wire::{
    CommandDatagram, FriControlStrategy, JOINTS, MeasurementDatagram, flags,
};

/// Command flags in Cartesian impedance control.
pub const CARTESIAN_FLAGS: u32 = flags::JOINT_POSITION
    | flags::CARTESIAN_POSITION
    | flags::TCP_WRENCH
    | flags::CARTESIAN_STIFFNESS
    | flags::CARTESIAN_DAMPING;
/// Command flags in joint impedance control.
pub const JOINT_FLAGS: u32 =
    flags::JOINT_POSITION | flags::JOINT_TORQUE | flags::JOINT_STIFFNESS | flags::JOINT_DAMPING;
/// Tolerance of a rotation's columns against orthonormality: rounding to binary32, and the controller's own rounding.
const ORTHONORMAL: f64 = 1e-3;

/// Encodes answers for each control strategy; knows the arm's impedance limits and its tool frame.
#[derive(Clone, Debug)]
pub struct StrategyEncoder {
    arm: Option<Arm>,
    limits: Option<ImpedanceLimits>,
    /// Tool frame relative to the flange as the controller uses it; `None`: its Cartesian pose is not valid.
    tool: Option<Pose>,
    /// Pose at which the controller holds the tool, in wire format.
    mirror: [f32; 12],
}

impl StrategyEncoder {
    /// Returns an encoder for the device's robot.
    pub fn of(device: &DeviceConfig) -> Self {
        let model = device.model();
        Self {
            arm: model.arm,
            limits: model.impedance,
            tool: None,
            mirror: [0.0; 12],
        }
    }

    /// Returns the control mode of the controller, or `None` if the arm cannot be commanded in it.
    pub fn runs(&self, measured: &MeasurementDatagram) -> Option<ControlMode> {
        let soft = self.limits.is_some();
        match measured.control {
            FriControlStrategy::Position => Some(ControlMode::Position),
            FriControlStrategy::CartesianImpedance if soft => Some(ControlMode::CartesianImpedance),
            FriControlStrategy::JointImpedance if soft => Some(ControlMode::JointImpedance),
            _ => None,
        }
    }

    /// Returns true if the controller's Cartesian pose is valid.
    pub fn knows_the_tool(&self) -> bool {
        self.tool.is_some()
    }

    /// Stores the pose at which the controller holds the tool, and derives the tool frame from the joint positions
    /// `held` (rad).
    pub fn mirror(&mut self, measured: &MeasurementDatagram, held: &Joints) {
        let pose = held_pose(measured);
        self.tool = pose.and_then(|pose| {
            let flange = self.arm?.forward(held);
            Some(flange.inverse().compose(&pose))
        });
        self.mirror = match pose {
            Some(pose) if !is_unmoved(&measured.commanded_pose_offset) => wire_pose(&pose),
            _ => measured.commanded_pose,
        };
    }

    /// Fills in the fields of an answer for this control mode; `position` holds the joint set-points (rad) if the
    /// controller follows.
    pub fn fill(
        &self,
        answer: &mut CommandDatagram,
        strategy: ControlMode,
        (impedance, position): (&Impedance, Option<&Joints>),
    ) {
        // Without a command for this mode, the arm is held with its default impedance.
        let held = self
            .limits
            .map(|limits| limits.default_hold(strategy, JOINTS));
        let commanded = match held {
            Some(held) if impedance.strategy != strategy as u64 => held,
            _ => *impedance,
        };
        let added = match position {
            Some(_) => commanded.added,
            None => Impedance::NONE.added,
        };
        match strategy {
            ControlMode::Position => answer.flags = flags::JOINT_POSITION,
            ControlMode::JointImpedance => {
                answer.flags = JOINT_FLAGS;
                answer.joint_stiffness = seven(&commanded.stiffness);
                answer.joint_damping = seven(&commanded.damping);
                answer.additional_joint_torque = seven(&added);
            }
            ControlMode::CartesianImpedance => {
                answer.flags = CARTESIAN_FLAGS;
                answer.cartesian_stiffness = six(&commanded.stiffness);
                answer.cartesian_damping = six(&commanded.damping);
                answer.additional_tcp_wrench = six(&added);
                answer.cartesian_position = self.pose(position);
            }
        }
    }

    fn pose(&self, position: Option<&Joints>) -> [f32; 12] {
        let (Some(position), Some(arm), Some(tool)) = (position, self.arm, self.tool) else {
            return self.mirror;
        };
        wire_pose(&arm.forward(position).compose(&tool))
    }
}

/// Returns the pose at which the controller holds the tool: its own pose plus FRI's offset. `None` if that is not a
/// valid pose.
fn held_pose(measured: &MeasurementDatagram) -> Option<Pose> {
    let own = pose(&measured.commanded_pose)?;
    let added = measured.commanded_pose_offset;
    if is_unmoved(&added) {
        return Some(own);
    }
    let added = pose(&added)?;
    let turned = Pose {
        position: [0.0; 3],
        orientation: added.orientation,
    };
    let turned = turned.compose(&Pose {
        position: [0.0; 3],
        orientation: own.orientation,
    });
    let mut position = own.position;
    for (place, added) in position.iter_mut().zip(added.position) {
        *place += added;
    }
    Some(Pose {
        position,
        orientation: turned.orientation,
    })
}

/// Returns true for the identity offset; a controller without an offset may also send zeros.
fn is_unmoved(offset: &[f32; 12]) -> bool {
    const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    *offset == IDENTITY || *offset == [0.0; 12]
}

/// Decodes a 3×4 row-major `[R|p]`, p in m; `None` if R is not a rotation.
fn pose(wire: &[f32; 12]) -> Option<Pose> {
    let value = |row: usize, column: usize| f64::from(wire[4 * row + column]);
    let rotation: [[f64; 3]; 3] =
        std::array::from_fn(|row| std::array::from_fn(|column| value(row, column)));
    let position = std::array::from_fn(|row| value(row, 3));
    let dot = |a: usize, b: usize| (0..3).map(|i| rotation[i][a] * rotation[i][b]).sum::<f64>();
    let is_orthonormal = (0..3)
        .all(|a| (0..3).all(|b| (dot(a, b) - f64::from(u8::from(a == b))).abs() <= ORTHONORMAL));
    let [[a, b, c], [d, e, f], [g, h, i]] = rotation;
    let right_handed = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0.0;
    let pose = Pose::from_rotation_matrix(position, &rotation);
    (is_orthonormal && right_handed && pose.is_finite()).then_some(pose)
}

fn wire_pose(pose: &Pose) -> [f32; 12] {
    let rotation = pose.rotation_matrix();
    std::array::from_fn(|place| match (place / 4, place % 4) {
        (row, 3) => pose.position[row] as f32,
        (row, column) => rotation[row][column] as f32,
    })
}

/// Converts x y z rx ry rz to KUKA's x y z A B C, the rotations about z, y, x.
fn six(values: &Joints) -> [f32; 6] {
    let [x, y, z, rx, ry, rz, ..] = values.map(|value| value as f32);
    [x, y, z, rz, ry, rx]
}

fn seven(values: &Joints) -> [f32; JOINTS] {
    std::array::from_fn(|joint| values[joint] as f32)
}
