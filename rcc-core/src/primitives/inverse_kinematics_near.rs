//! `InverseKinematicsNear`: joint positions of a seven-joint arm for a flange pose and an arm angle, in the branch of others.
//!
//! `InverseKinematics` keeps arm angle and branch of the start; here the net decides both in each cycle, from what it likes.

use crate::frame::Frame;
use crate::message::Joints;
use crate::primitive::{Entry, Kernel, Parameter, Port, PortType, Spec, UnitRule, each};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "InverseKinematicsNear",
        summary: "Joint positions for a flange pose with a given arm angle, in the branch of given joint positions.",
        null: "a null input and a pose that cannot be reached give null",
        undefined: "the pose cannot be reached; overflow: an infinite input",
        formula: "closed form: Shimizu et al., IEEE T-RO 24(5), 2008, and Faria et al., Mech. Mach. Theory 121, 2018",
        inputs: &[
            Port::typed("pose", Type::Pose, "flange in the arm's base"),
            Port::real(
                "arm_angle",
                UnitRule::Is(Unit::RADIAN),
                "turn of the elbow about the line from shoulder to wrist, as ArmAngle gives it",
            ),
            Port::new(
                "hint",
                PortType::Joints,
                UnitRule::Is(Unit::RADIAN),
                "joint positions that say the branch, and the angles that a stretched joint leaves open, A1 first",
            ),
        ],
        outputs: &[Port::new(
            "joints",
            PortType::Joints,
            UnitRule::Is(Unit::RADIAN),
            "joint positions, A1 first, each in [-π, π]; joint limits are the guard's business",
        )],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [pose, angle, hint, joints, device, width]: [u32; 6]) {
    let (pose, angle) = (frame.known_pose(pose), frame.real(angle));
    let near = frame.arm_at(device, hint, width);
    let solution = near
        .zip(pose)
        .and_then(|((arm, hint), pose)| arm.inverse(&pose, angle, arm.branch(&hint), &hint).ok());
    let padded: Option<Joints> =
        solution.map(|[q1, q2, q3, q4, q5, q6, q7]| [q1, q2, q3, q4, q5, q6, q7, 0.0]);
    frame.set_joints(joints, width, padded.as_ref());
}

#[cfg(test)]
mod tests {
    use crate::testing::Bench;

    const JOINTS: [f64; 7] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4];

    #[test]
    fn arm_angle_pose_and_branch_of_joints_give_the_joints_back() {
        let mut bench = Bench::new("InverseKinematicsNear");
        let arm = bench.model.arm.unwrap();
        bench.set_reals("pose", &arm.forward(&JOINTS).to_slots());
        bench.set_real("arm_angle", arm.arm_angle(&JOINTS));
        // Others of the same branch do as well.
        bench.set_reals("hint", &[0.0, 0.1, 0.0, -0.1, 0.0, 0.1, 0.0]);
        for (got, want) in bench.step().reals("joints", 7).iter().zip(JOINTS) {
            assert!((got - want).abs() < 1e-12, "{got} {want}");
        }
    }

    #[test]
    fn the_elbow_goes_round_while_the_flange_stays() {
        let mut bench = Bench::new("InverseKinematicsNear");
        let arm = bench.model.arm.unwrap();
        let pose = arm.forward(&JOINTS);
        bench
            .set_reals("pose", &pose.to_slots())
            .set_reals("hint", &JOINTS);
        for step in -3..=3 {
            let angle = f64::from(step);
            let joints = bench.set_real("arm_angle", angle).step().reals("joints", 7);
            let joints: [f64; 7] = joints.try_into().unwrap();
            let there = arm.forward(&joints);
            assert!(there.distance_to(&pose) < 1e-12 && there.angle_to(&pose) < 1e-12);
            assert!((arm.arm_angle(&joints) - angle).abs() < 1e-9);
        }
    }

    #[test]
    fn null_or_out_of_reach_is_null() {
        let mut bench = Bench::new("InverseKinematicsNear");
        bench.set_real("arm_angle", 0.0).set_reals("hint", &JOINTS);
        for pose in [[9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [f64::NAN; 7]] {
            let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
            assert!(joints.iter().all(|q| q.is_nan()));
        }
    }
}
