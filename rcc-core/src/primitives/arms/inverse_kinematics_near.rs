//! `InverseKinematicsNear`: joint positions of an arm for a flange pose and an arm angle, in the branch of given joint
//! positions.
//!
//! `InverseKinematics` keeps arm angle and branch of the start; here the net chooses both in each cycle.

use super::inverse_kinematics::{JOINT, JointSolution, REASON};
use crate::frame::Frame;
use crate::joints::JOINTS_MAX;
use crate::kinematics::{ArmConfiguration, Unreachable};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Int, Kernel, Parameter, Port, PortType, Real, Slot, Spec, Step,
    UnitRule, operands,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "InverseKinematicsNear",
        summary: "Joint positions for a flange pose with a given arm angle, in the branch of given joint positions.",
        null: "a null input, and a pose that is out of reach or beyond a joint limit, give null; `reason` tells which; a null `arm_angle` is ignored for an arm that has none",
        undefined: "the pose is out of reach; a joint would be beyond its limit; overflow: an infinite input",
        formula: "see InverseKinematics",
        inputs: &[
            Port::typed("pose", Type::Pose, "flange in the arm's base"),
            Port::real(
                "arm_angle",
                UnitRule::Is(Unit::RADIAN),
                "rotation of the elbow about the line from shoulder to wrist, as given by ArmAngle (for an arm of seven joints with numeric inverse kinematics the position of its redundant joint); ignored for an arm that has none",
            ),
            Port::new(
                "hint",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint positions that determine the branch (with numeric inverse kinematics: from which it starts), the angles that aligned axes leave open, and the choice among several turns, A1 first",
            ),
        ],
        outputs: &[
            Port::new(
                "joints",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint positions, A1 first, within the limits of the robot's configuration, by the turn nearest to the hint",
            ),
            Port::int("reason", REASON).within(0.0, 5.0).diagnostic(),
            Port::int("joint", JOINT)
                .within(0.0, JOINTS_MAX as f64)
                .diagnostic(),
        ],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<InverseKinematicsNear>()],
);

operands! {
    struct InverseKinematicsNear {
        pose: Slot<Pose>, arm_angle: Slot<Real>, hint: Slot<Real>, joints: Slot<Real>, reason: Slot<Int>,
        joint: Slot<Int>, device: Device, width: u32,
    }
}

impl Step for InverseKinematicsNear {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (pose, angle) = (frame.known_pose(self.pose), frame.get(self.arm_angle)?);
        let near = frame.joints(self.hint, self.width).zip(pose);
        let device = frame.arm(self.device).zip(frame.limits(self.device));
        let found = device.map(|(arm, limits)| {
            let (hint, pose) = near
                .filter(|(hint, _)| hint.iter().all(|joint| joint.is_finite()))
                .ok_or(Unreachable::NotFinite)?;
            let configuration = ArmConfiguration {
                branch: arm.branch(&hint),
                // Null is refused for an arm that has one.
                arm_angle: if arm.has_arm_angle() { angle } else { 0.0 },
            };
            arm.inverse_within(&pose, configuration, &hint, limits)
        });
        let outputs = JointSolution {
            joints: self.joints,
            width: self.width,
            reason: self.reason,
            joint: self.joint,
        };
        outputs.put(frame, found)
    }
}

#[cfg(test)]
mod tests {
    use crate::frame::joints_from;
    use crate::testing::{PrimitiveHarness, kr6};

    const JOINTS: [f64; 8] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

    #[test]
    fn arm_angle_pose_and_branch_of_joints_give_the_joints_back() {
        let mut bench = PrimitiveHarness::new("InverseKinematicsNear");
        let arm = bench.model.arm.unwrap();
        bench.set_reals("pose", &arm.forward(&JOINTS).to_slots());
        bench.set_real("arm_angle", arm.arm_angle(&JOINTS).unwrap());
        // Other joint positions of the same branch are valid, too.
        bench.set_reals("hint", &[0.0, 0.1, 0.0, -0.1, 0.0, 0.1, 0.0]);
        for (got, want) in bench.step().reals("joints", 7).iter().zip(JOINTS) {
            assert!((got - want).abs() < 1e-12, "{got} {want}");
        }
    }

    #[test]
    fn the_elbow_goes_round_while_the_flange_stays() {
        let mut bench = PrimitiveHarness::new("InverseKinematicsNear");
        bench.model.limits.lower = [-4.0; 8];
        bench.model.limits.upper = [4.0; 8];
        let arm = bench.model.arm.unwrap();
        let pose = arm.forward(&JOINTS);
        bench
            .set_reals("pose", &pose.to_slots())
            .set_reals("hint", &JOINTS[..7]);
        for step in -3..=3 {
            let angle = f64::from(step);
            let joints = bench.set_real("arm_angle", angle).step().reals("joints", 7);
            let joints = joints_from(joints).unwrap();
            let there = arm.forward(&joints);
            assert!(there.distance_to(&pose) < 1e-12 && there.angle_to(&pose) < 1e-12);
            assert!((arm.arm_angle(&joints).unwrap() - angle).abs() < 1e-9);
        }
    }

    #[test]
    fn six_joints_need_no_arm_angle() {
        let mut bench = PrimitiveHarness::wide("InverseKinematicsNear", None, 6);
        bench.model = kr6();
        let there = [0.4, -1.3, 1.1, 0.7, 0.6, 0.2, 0.0, 0.0];
        let pose = bench.model.arm.unwrap().forward(&there).to_slots();
        bench
            .set_reals("pose", &pose)
            .set_real("arm_angle", f64::NAN);
        bench.set_reals("hint", &[0.0, -1.0, 0.9, 0.0, 0.3, 0.0]);
        for (got, want) in bench.step().reals("joints", 6).iter().zip(there) {
            assert!((got - want).abs() < 1e-9, "{got} {want}");
        }
        assert_eq!(bench.int("reason"), 0);
    }

    #[test]
    fn null_or_out_of_reach_is_null() {
        let mut bench = PrimitiveHarness::new("InverseKinematicsNear");
        bench
            .set_real("arm_angle", 0.0)
            .set_reals("hint", &JOINTS[..7]);
        for pose in [[9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [f64::NAN; 7]] {
            let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
            assert!(joints.iter().all(|q| q.is_nan()));
        }
    }
}
