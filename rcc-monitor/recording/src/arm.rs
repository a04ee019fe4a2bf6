//! The links of an arm as frames, and the arms of a cell as URDF, from the kinematics of the core. Pure.

use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, SerialArm};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_core::{rotation, vector};

const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// Radius of the cylinders that stand for links, m.
const LINK_RADIUS_M: f64 = 0.05;

/// An arm for viewers.
#[derive(Clone, Debug)]
pub struct ViewedArm {
    /// Name of the device.
    pub device: String,
    /// Pose of its base in the world frame.
    pub base: Pose,
    /// Kinematics.
    pub arm: Arm,
    /// Limits of its joints.
    pub limits: JointLimits,
    chain: ArmChain,
}

/// A joint: where it is in the frame of the link before it, and about which axis it turns, or along which it moves.
#[derive(Clone, Copy, Debug)]
struct ChainJoint {
    offset: [f64; 3],
    /// Direction of the axis, of length 1.
    axis: [f64; 3],
    /// Angle about the axis at which the robot's joint is 0, rad.
    zero: f64,
}

#[derive(Clone, Debug)]
struct ArmChain {
    joints: Vec<ChainJoint>,
    /// The flange in the frame of the last link.
    flange: Pose,
}

impl ArmChain {
    fn of(arm: &Arm) -> ArmChain {
        let (rows, signs, zeros, flange): (Vec<_>, Vec<_>, Vec<_>, _) = match arm {
            Arm::Srs(arm) => {
                let rows = vec![
                    ([0.0, 0.0, arm.shoulder_height], Z),
                    ([0.0; 3], Y),
                    ([0.0, 0.0, arm.upper_arm], Z),
                    ([0.0; 3], Y),
                    ([0.0, 0.0, arm.forearm], Z),
                    ([0.0; 3], Y),
                    ([0.0; 3], Z),
                ];
                let flange = along_z(arm.wrist_to_flange);
                (rows, arm.signs.to_vec(), vec![0.0; 7], flange)
            }
            Arm::OrthoParallel(arm) => {
                let rows = vec![
                    ([0.0, 0.0, arm.shoulder_height], Z),
                    ([arm.shoulder_offset, arm.lateral_offset, 0.0], Y),
                    ([0.0, 0.0, arm.upper_arm], Y),
                    ([arm.elbow_offset, 0.0, arm.forearm], Z),
                    ([0.0; 3], Y),
                    ([0.0; 3], Z),
                ];
                let flange = along_z(arm.wrist_to_flange);
                (rows, arm.signs.to_vec(), arm.zeros.to_vec(), flange)
            }
            Arm::Serial(arm) => return ArmChain::of_axes(arm),
        };
        let joints = rows.into_iter().zip(signs).zip(zeros);
        let joints = joints.map(|(((offset, axis), sign), zero)| ChainJoint {
            offset,
            axis: axis.map(|x| sign * x + 0.0),
            zero: sign * zero,
        });
        ArmChain {
            joints: joints.collect(),
            flange,
        }
    }

    /// The frame of each link is parallel to the base with all joints at 0, at the point of its axis.
    fn of_axes(arm: &SerialArm) -> ArmChain {
        let mut last = [0.0; 3];
        let joints = arm.axes().iter().map(|axis| {
            let offset = vector::subtract(axis.point, last);
            last = axis.point;
            ChainJoint {
                offset,
                axis: axis.direction,
                zero: 0.0,
            }
        });
        let joints = joints.collect();
        let flange = arm.flange();
        ArmChain {
            joints,
            flange: Pose {
                position: vector::subtract(flange.position, last),
                ..flange
            },
        }
    }
}

impl ViewedArm {
    /// Describes an arm.
    #[must_use]
    pub fn new(device: &str, base: Pose, arm: Arm, limits: JointLimits) -> ViewedArm {
        ViewedArm {
            device: device.to_owned(),
            base,
            arm,
            limits,
            chain: ArmChain::of(&arm),
        }
    }

    /// Number of joints.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.chain.joints.len()
    }

    /// Returns the name of a joint, counted from 1.
    #[must_use]
    pub fn joint_name(&self, number: usize) -> String {
        format!("{}_joint_{number}", self.device)
    }

    /// Returns the name of the frame of its base.
    #[must_use]
    pub fn base_frame(&self) -> String {
        format!("{}_base", self.device)
    }

    /// Returns the name of the frame of its flange.
    #[must_use]
    pub fn flange_frame(&self) -> String {
        format!("{}_flange", self.device)
    }

    fn link_frame(&self, number: usize) -> String {
        match number {
            0 => self.base_frame(),
            number if number > self.joints() => self.flange_frame(),
            number => format!("{}_link_{number}", self.device),
        }
    }

    /// Returns each frame of the arm at these joints (rad; linear axes: m): its parent, its name, and its pose in the parent. The first is the
    /// base in `world`, the last the flange.
    #[must_use]
    pub fn frames(&self, joints: &Joints) -> Vec<(String, String, Pose)> {
        let mut frames = vec![("world".to_owned(), self.base_frame(), self.base)];
        for (index, (joint, position)) in self.chain.joints.iter().zip(joints).enumerate() {
            let pose = match self.arm.is_linear() {
                true => Pose {
                    position: vector::add(joint.offset, joint.axis.map(|x| x * position)),
                    orientation: Pose::IDENTITY.orientation,
                },
                false => Pose {
                    position: joint.offset,
                    orientation: rotation::exp(joint.axis.map(|x| x * (position + joint.zero))),
                },
            };
            frames.push((self.link_frame(index), self.link_frame(index + 1), pose));
        }
        let last = self.joints();
        let flange = self.link_frame(last + 1);
        frames.push((self.link_frame(last), flange, self.chain.flange));
        frames
    }

    /// Appends its links and joints.
    fn urdf(&self, text: &mut String) {
        let world = Pose::to_slots(&self.base);
        let [x, y, z, ..] = world;
        let [roll, pitch, yaw] = rpy(&self.base);
        text.push_str(&format!(
            "  <joint name=\"{}_mount\" type=\"fixed\">\n    <parent link=\"world\"/><child link=\"{}\"/>\n    <origin \
             xyz=\"{x} {y} {z}\" rpy=\"{roll} {pitch} {yaw}\"/>\n  </joint>\n",
            self.device,
            self.base_frame()
        ));
        let offsets = self.chain.joints.iter().map(|joint| joint.offset);
        let offsets = offsets.chain([self.chain.flange.position]);
        for (index, offset) in offsets.enumerate() {
            text.push_str(&link(&self.link_frame(index), offset));
        }
        text.push_str(&link(&self.link_frame(self.joints() + 1), [0.0; 3]));
        for (index, joint) in self.chain.joints.iter().enumerate() {
            text.push_str(&self.urdf_joint(index, joint));
        }
        let (last, [x, y, z]) = (self.joints(), self.chain.flange.position);
        let [roll, pitch, yaw] = rpy(&self.chain.flange);
        text.push_str(&format!(
            "  <joint name=\"{}_flange_joint\" type=\"fixed\">\n    <parent link=\"{}\"/><child link=\"{}\"/>\n    <origin \
             xyz=\"{x} {y} {z}\" rpy=\"{roll} {pitch} {yaw}\"/>\n  </joint>\n",
            self.device,
            self.link_frame(last),
            self.link_frame(last + 1)
        ));
    }

    fn urdf_joint(&self, index: usize, joint: &ChainJoint) -> String {
        let [x, y, z] = joint.offset;
        let [roll, pitch, yaw] = rpy(&Pose {
            position: [0.0; 3],
            orientation: rotation::exp(joint.axis.map(|x| x * joint.zero)),
        });
        let [ax, ay, az] = joint.axis;
        let kind = match self.arm.is_linear() {
            true => "prismatic",
            false => "revolute",
        };
        let column = |of: &Joints| of.get(index).copied().unwrap_or(0.0);
        format!(
            "  <joint name=\"{}\" type=\"{kind}\">\n    <parent link=\"{}\"/><child link=\"{}\"/>\n    <origin xyz=\"{x} {y} \
             {z}\" rpy=\"{roll} {pitch} {yaw}\"/><axis xyz=\"{ax} {ay} {az}\"/>\n    <limit lower=\"{}\" upper=\"{}\" velocity=\"{}\" \
             effort=\"0\"/>\n  </joint>\n",
            self.joint_name(index + 1),
            self.link_frame(index),
            self.link_frame(index + 1),
            column(&self.limits.lower),
            column(&self.limits.upper),
            column(&self.limits.velocity_max),
        )
    }
}

fn along_z(way: f64) -> Pose {
    Pose::from_xyz_rpy([0.0, 0.0, way], [0.0; 3])
}

/// Roll, pitch and yaw of a pose, rad.
fn rpy(pose: &Pose) -> [f64; 3] {
    let [[m11, _, _], [m21, _, _], [m31, m32, m33]] = pose.rotation_matrix();
    [m32.atan2(m33), (-m31).atan2(m11.hypot(m21)), m21.atan2(m11)]
}

/// A link that reaches from its own origin to the next joint: a cylinder, or nothing if it has no length.
fn link(name: &str, [x, y, z]: [f64; 3]) -> String {
    let length = (x * x + y * y + z * z).sqrt();
    if length < 1e-6 {
        return format!("  <link name=\"{name}\"/>\n");
    }
    let (pitch, yaw) = (x.hypot(y).atan2(z), y.atan2(x));
    format!(
        "  <link name=\"{name}\">\n    <visual>\n      <origin xyz=\"{} {} {}\" rpy=\"0 {pitch} {yaw}\"/>\n      \
         <geometry><cylinder radius=\"{LINK_RADIUS_M}\" length=\"{length}\"/></geometry>\n    </visual>\n  </link>\n",
        x / 2.0,
        y / 2.0,
        z / 2.0
    )
}

/// Returns the arms of a cell as one URDF text; its frames are those of [`ViewedArm::frames`].
#[must_use]
pub fn urdf(cell: &str, arms: &[ViewedArm]) -> String {
    let mut text =
        format!("<?xml version=\"1.0\"?>\n<robot name=\"{cell}\">\n  <link name=\"world\"/>\n");
    for arm in arms {
        arm.urdf(&mut text);
    }
    text.push_str("</robot>\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_core::kinematics::{JointAxis, OrthoParallelArm, SrsArm};

    fn arms() -> [Arm; 4] {
        let axis = |point, direction| JointAxis { point, direction };
        let axes = [
            axis([0.0, 0.0, 0.2], [0.0, 0.0, 1.0]),
            axis([0.3, 0.1, 0.2], [0.0, -0.6, 0.8]),
            axis([0.6, 0.1, 0.4], [1.0, 0.0, 0.0]),
        ];
        let flange = Pose::from_xyz_rpy([0.7, 0.0, 0.3], [0.4, -0.3, 0.2]);
        [
            Arm::Serial(SerialArm::new(&axes, flange, 0).unwrap()),
            Arm::Serial(SerialArm::of_linear_axes(&axes, flange).unwrap()),
            Arm::Srs(SrsArm {
                shoulder_height: 0.31,
                upper_arm: 0.4,
                forearm: 0.39,
                wrist_to_flange: 0.078,
                signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
            }),
            Arm::OrthoParallel(OrthoParallelArm {
                shoulder_height: 0.4,
                shoulder_offset: 0.025,
                lateral_offset: 0.01,
                upper_arm: 0.455,
                elbow_offset: 0.035,
                forearm: 0.42,
                wrist_to_flange: 0.08,
                signs: [-1.0, 1.0, 1.0, -1.0, 1.0, -1.0],
                zeros: [0.0, 1.5, -1.4, 0.1, 0.0, 3.1],
            }),
        ]
    }

    fn viewed(arm: Arm) -> ViewedArm {
        let base = Pose::from_xyz_rpy([1.0, -2.0, 0.5], [0.1, -0.2, 0.3]);
        ViewedArm::new("lwr", base, arm, rcc_core::frame::DeviceModel::NONE.limits)
    }

    #[test]
    fn the_frames_of_an_arm_end_where_its_kinematics_put_the_flange() {
        let joints = [0.3, -0.7, 0.2, 1.1, -0.4, 0.9, 0.5, 0.0];
        for arm in arms() {
            let viewed = viewed(arm);
            let frames = viewed.frames(&joints);
            assert_eq!(frames.len(), viewed.joints() + 2);
            assert_eq!(frames[0].0, "world");
            for pair in frames.windows(2) {
                assert_eq!(pair[0].1, pair[1].0, "each frame is in the one before it");
            }
            let flange = frames[1..]
                .iter()
                .fold(Pose::IDENTITY, |pose, (_, _, next)| pose.compose(next));
            let want = arm.forward(&joints);
            assert!(flange.distance_to(&want) < 1e-12, "{flange:?} {want:?}");
            assert!(flange.angle_to(&want) < 1e-7, "{flange:?} {want:?}");
        }
    }

    #[test]
    fn the_urdf_has_every_frame_and_the_angles_of_the_base() {
        for arm in arms() {
            let viewed = viewed(arm);
            let text = urdf("demo", std::slice::from_ref(&viewed));
            for (parent, child, _) in viewed.frames(&[0.0; 8]) {
                let row = format!("<parent link=\"{parent}\"/><child link=\"{child}\"/>");
                assert_eq!(text.matches(&row).count(), 1, "{row}\n{text}");
            }
            let [roll, pitch, yaw] = rpy(&viewed.base);
            assert!((roll - 0.1).abs() < 1e-12 && (pitch + 0.2).abs() < 1e-12);
            assert!((yaw - 0.3).abs() < 1e-12);
        }
    }
}
