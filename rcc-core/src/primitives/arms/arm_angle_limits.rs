//! `ArmAngleLimits`: the range through which the elbow of a seven-joint arm can swivel while its flange keeps a pose.
//!
//! With it a net chooses the arm angle itself, within the joint limits and without a jump to another interval, and
//! passes it to `InverseKinematicsNear`.

use crate::frame::Frame;
use crate::kinematics::Arm;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Example, Kernel, Parameter, Port, PortType, Real, Slot, Spec, Step,
    UnitRule, finite, operands,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ArmAngleLimits",
        summary: "The interval of arm angles, around that of given joints, in which a flange pose is within the joint limits, in their branch.",
        null: "a null input gives null outputs; only arms of type `srs` have these limits: null for others",
        undefined: "the pose is out of reach; a joint would be beyond its limit with the arm angle of `hint`; the arm is not of type `srs`; overflow: an infinite input",
        formula: "each joint limit as A sin ψ + B cos ψ + C = 0 (Shimizu et al., IEEE T-RO 24(5), 2008, section IV)",
        examples: &[Example::new(
            "a null pose, and a pose out of reach",
            "{device: lwr}",
            "pose | hint | lower | upper\n\
             null | [0, 0.5, 0, 1, 0, 0.3, 0] | null | null\n\
             {xyz: [9, 0, 0], rpy: [0, 0, 0]} | [0, 0.5, 0, 1, 0, 0.3, 0] | null | null",
        )],
        inputs: &[
            Port::typed("pose", Type::Pose, "flange in the arm's base"),
            Port::new(
                "hint",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint positions that give the branch, and the arm angle around which to search, A1 first",
            ),
        ],
        outputs: &[
            Port::real(
                "lower",
                UnitRule::Is(Unit::RADIAN),
                "smallest arm angle, at most that of `hint`",
            ),
            Port::real(
                "upper",
                UnitRule::Is(Unit::RADIAN),
                "largest arm angle, at least that of `hint`; beyond ±π the interval continues through π; without limits the interval extends π to both sides",
            ),
        ],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<ArmAngleLimits>()],
);

operands! {
    struct ArmAngleLimits {
        pose: Slot<Pose>, hint: Slot<Real>, lower: Slot<Real>, upper: Slot<Real>, device: Device, width: u32,
    }
}

impl Step for ArmAngleLimits {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let pose = frame.known_pose(self.pose);
        let there = frame.arm_at(self.device, self.hint, self.width).zip(pose);
        let limits = frame.limits(self.device);
        let found = there.zip(limits).and_then(|(((arm, hint), pose), limits)| {
            let Arm::Srs(srs) = arm else {
                return None;
            };
            let angles = srs.arm_angles(&pose, arm.branch(&hint), limits).ok()?;
            angles.around(arm.arm_angle(&hint)?)
        });
        let [from, to] = found.map_or([f64::NAN; 2], |interval| interval);
        frame.put(self.lower, finite(from))?;
        frame.put(self.upper, finite(to))
    }
}

#[cfg(test)]
mod tests {
    use crate::frame::joints_from;
    use crate::testing::{PrimitiveHarness, kr6};

    const JOINTS: [f64; 8] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

    #[test]
    fn at_either_end_a_joint_is_at_its_limit() {
        let mut bench = PrimitiveHarness::new("ArmAngleLimits");
        let arm = bench.model.arm.unwrap();
        let limits = bench.model.limits;
        let pose = arm.forward(&JOINTS);
        bench.set_reals("pose", &pose.to_slots());
        bench.set_reals("hint", &JOINTS[..7]).step();
        let (lower, upper) = (bench.real("lower"), bench.real("upper"));
        let angle = arm.arm_angle(&JOINTS).unwrap();
        assert!(lower < angle && angle < upper, "{lower} {angle} {upper}");
        for end in [lower, upper] {
            let joints = arm.inverse(&pose, end, arm.branch(&JOINTS), &[0.0; 8]);
            let joints = joints_from(&joints.unwrap()).unwrap();
            let room =
                (0..7).map(|i| (joints[i] - limits.lower[i]).min(limits.upper[i] - joints[i]));
            let least = room.fold(f64::INFINITY, f64::min);
            assert!(least.abs() < 1e-9, "{end}: {least}");
        }
    }

    #[test]
    fn six_joints_have_no_arm_angle() {
        let mut bench = PrimitiveHarness::wide("ArmAngleLimits", None, 6);
        bench.model = kr6();
        bench.set_reals("pose", &kr6().arm.unwrap().forward(&[0.1; 8]).to_slots());
        bench.set_reals("hint", &[0.1; 6]).step();
        assert!(bench.real("lower").is_nan() && bench.real("upper").is_nan());
    }
}
