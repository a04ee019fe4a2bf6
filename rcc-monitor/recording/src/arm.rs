//! The links of an arm as frames, and the arms of a cell as URDF, from the kinematics of the core. Pure.

use rcc_core::guard::JointLimits;
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::pose::Pose;

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

/// A joint: where it is in the frame of the link before it, and about which axis it turns.
#[derive(Clone, Copy, Debug)]
struct ChainJoint {
    offset: [f64; 3],
    /// True: turns about y; false: about z.
    about_y: bool,
    /// +1 or −1.
    sign: f64,
    /// Angle at which the robot's joint is 0, rad.
    zero: f64,
}

#[derive(Clone, Debug)]
struct ArmChain {
    joints: Vec<ChainJoint>,
    /// The flange in the frame of the last link.
    flange: [f64; 3],
}

impl ArmChain {
    fn of(arm: &Arm) -> ArmChain {
        let (rows, signs, zeros, flange) = match arm {
            Arm::Srs(arm) => {
                let rows = vec![
                    ([0.0, 0.0, arm.shoulder_height], false),
                    ([0.0; 3], true),
                    ([0.0, 0.0, arm.upper_arm], false),
                    ([0.0; 3], true),
                    ([0.0, 0.0, arm.forearm], false),
                    ([0.0; 3], true),
                    ([0.0; 3], false),
                ];
                (rows, arm.signs.to_vec(), vec![0.0; 7], arm.wrist_to_flange)
            }
            Arm::OrthoParallel(arm) => {
                let rows = vec![
                    ([0.0, 0.0, arm.shoulder_height], false),
                    ([arm.shoulder_offset, arm.lateral_offset, 0.0], true),
                    ([0.0, 0.0, arm.upper_arm], true),
                    ([arm.elbow_offset, 0.0, arm.forearm], false),
                    ([0.0; 3], true),
                    ([0.0; 3], false),
                ];
                (
                    rows,
                    arm.signs.to_vec(),
                    arm.zeros.to_vec(),
                    arm.wrist_to_flange,
                )
            }
        };
        let joints = rows.into_iter().zip(signs).zip(zeros);
        let joints = joints.map(|(((offset, about_y), sign), zero)| ChainJoint {
            offset,
            about_y,
            sign,
            zero,
        });
        ArmChain {
            joints: joints.collect(),
            flange: [0.0, 0.0, flange],
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

    /// Returns each frame of the arm at these joints (rad): its parent, its name, and its pose in the parent. The first is the
    /// base in `world`, the last the flange.
    #[must_use]
    pub fn frames(&self, joints: &Joints) -> Vec<(String, String, Pose)> {
        let mut frames = vec![("world".to_owned(), self.base_frame(), self.base)];
        for (index, (joint, position)) in self.chain.joints.iter().zip(joints).enumerate() {
            let angle = joint.sign * position + joint.zero;
            let rpy = match joint.about_y {
                true => [0.0, angle, 0.0],
                false => [0.0, 0.0, angle],
            };
            let pose = Pose::from_xyz_rpy(joint.offset, rpy);
            frames.push((self.link_frame(index), self.link_frame(index + 1), pose));
        }
        let last = self.joints();
        let flange = Pose::from_xyz_rpy(self.chain.flange, [0.0; 3]);
        frames.push((self.link_frame(last), self.link_frame(last + 1), flange));
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
        let offsets = offsets.chain([self.chain.flange]);
        for (index, offset) in offsets.enumerate() {
            text.push_str(&link(&self.link_frame(index), offset));
        }
        text.push_str(&link(&self.link_frame(self.joints() + 1), [0.0; 3]));
        for (index, joint) in self.chain.joints.iter().enumerate() {
            text.push_str(&self.urdf_joint(index, joint));
        }
        let (last, [x, y, z]) = (self.joints(), self.chain.flange);
        text.push_str(&format!(
            "  <joint name=\"{}_flange_joint\" type=\"fixed\">\n    <parent link=\"{}\"/><child link=\"{}\"/>\n    <origin \
             xyz=\"{x} {y} {z}\"/>\n  </joint>\n",
            self.device,
            self.link_frame(last),
            self.link_frame(last + 1)
        ));
    }

    fn urdf_joint(&self, index: usize, joint: &ChainJoint) -> String {
        let [x, y, z] = joint.offset;
        let (turned, axis) = match joint.about_y {
            true => (format!("0 {} 0", joint.zero), format!("0 {} 0", joint.sign)),
            false => (format!("0 0 {}", joint.zero), format!("0 0 {}", joint.sign)),
        };
        let column = |of: &Joints| of.get(index).copied().unwrap_or(0.0);
        format!(
            "  <joint name=\"{}\" type=\"revolute\">\n    <parent link=\"{}\"/><child link=\"{}\"/>\n    <origin xyz=\"{x} {y} \
             {z}\" rpy=\"{turned}\"/><axis xyz=\"{axis}\"/>\n    <limit lower=\"{}\" upper=\"{}\" velocity=\"{}\" \
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
    use rcc_core::kinematics::{OrthoParallelArm, SrsArm};

    fn arms() -> [Arm; 2] {
        [
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
