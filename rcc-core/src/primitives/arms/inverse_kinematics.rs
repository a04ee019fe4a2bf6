//! `InverseKinematics`: joint positions of an arm for a flange pose, continuous with the start position.
//!
//! The branch and, for seven joints, the arm angle are those of the arm's hold set-point when the command becomes
//! ready, or with `start: continue` of the set-point from which its net takes the arm over. They stay constant, so that the same pose always gives the same joints. Where an angle is undetermined (two
//! aligned axes), the last solution decides; each joint takes the turn nearest to the last solution and therefore never
//! jumps by a full turn.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::joints::{JOINTS_MAX, Joints};
use crate::kinematics::{Branch, InverseKinematicsError, within_limits};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Int, Kernel, Parameter, Port, PortType, Prepare, Real, Slot, Spec,
    StateSpec, Step, UnitRule, operands,
};
use crate::primitives::start;
use crate::types::{NULL_INT, Type};

/// Description of the port with the reason for missing joints.
pub(super) const REASON: &str = "why there are no joints: 0 no fault, 1 an input is null, 2 the wrist is too far from the shoulder, 3 too close to it (or to axis 1), 4 a joint limit, 5 the numeric inverse kinematics found none; null if the device is not an arm";
/// Description of the port with the joint at its limit.
pub(super) const JOINT: &str =
    "first joint that would exceed its limit, from 1; 0 for any other reason";

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "InverseKinematics",
        summary: "Joint positions for a flange pose, in the branch (and with the arm angle) of the start.",
        null: "a pose that is null, out of reach or beyond a joint limit gives null; `reason` tells which",
        undefined: "the pose is out of reach; a joint would be beyond its limit",
        formula: "closed form; seven joints: Shimizu et al., IEEE T-RO 24(5), 2008, and Faria et al., Mech. Mach. Theory 121, 2018; six joints: Brandstötter et al., Austrian Robotics Workshop, 2014; other arms: numeric, damped least squares in at most 40 steps, Sugihara, IEEE T-RO 27(5), 2011",
        inputs: &[Port::typed("pose", Type::Pose, "flange in the arm's base")],
        outputs: &[
            Port::new(
                "joints",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint positions, A1 first, within the limits of the robot's configuration",
            ),
            Port::int("reason", REASON).within(0.0, 5.0).diagnostic(),
            Port::int("joint", JOINT)
                .within(0.0, JOINTS_MAX as f64)
                .diagnostic(),
        ],
        parameters: &[
            Parameter::arm(),
            start::parameter(
                "hold: branch and arm angle are those in which the arm is held at LOAD or START; continue: those of the last set-point of \
                 the net from which a hand-over or a rule takes the arm, and otherwise those in which the arm is held then",
            ),
        ],
        // arm angle, branch index, hint joints
        state: StateSpec {
            reals: 2 + JOINTS_MAX as u32,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<InverseKinematics>()],
)
.prepared_by::<InverseKinematics>();

impl Prepare for InverseKinematics {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let (arm, hold) = preparation.arm_at_rest(self.device)?;
        let start = arm.configuration(&hold);
        let branch = f64::from(start.branch.index());
        preparation.put(self.state, [start.arm_angle, branch]);
        preparation.put(self.hint(), hold);
        Ok(())
    }
}

operands! {
    struct InverseKinematics {
        pose: Slot<Pose>, joints: Slot<Real>, reason: Slot<Int>, joint: Slot<Int>, device: Device,
        start: Slot<Int>,
        /// Arm angle and branch index; the hint joints follow.
        state: Slot<[Real; 2]>, width: u32,
    }
}

impl InverseKinematics {
    fn hint(self) -> Slot<[Real; JOINTS_MAX]> {
        (self.state + 2).cast()
    }

    /// In the first cycle with `start: continue`, takes branch and arm angle of the motion that the arm is in.
    fn take_over(self, frame: &mut Frame<'_>) -> Option<()> {
        let taken = start::taken_over(frame, self.device, self.start)?;
        let Some((arm, motion)) = frame.arm(self.device).zip(taken) else {
            return Some(());
        };
        let start = arm.configuration(&motion.position);
        let branch = f64::from(start.branch.index());
        frame.put(self.state, [start.arm_angle, branch])?;
        frame.put(self.hint(), motion.position)
    }
}

impl Step for InverseKinematics {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        self.take_over(frame)?;
        let [angle, branch] = frame.get(self.state)?;
        let hint: Joints = frame.get(self.hint())?;
        let pose = frame.get(self.pose)?;
        let device = frame.arm(self.device).zip(frame.limits(self.device));
        let found = device.map(|(arm, limits)| {
            let solution = arm.inverse(&pose, angle, Branch::from_bits(branch as u8), &hint)?;
            within_limits(&solution, limits)?;
            Ok(solution)
        });
        if let Some(Ok(solution)) = found {
            frame.put(self.hint(), solution)?;
        }
        let outputs = JointSolution {
            joints: self.joints,
            width: self.width,
            reason: self.reason,
            joint: self.joint,
        };
        outputs.put(frame, found)
    }
}

/// The outputs of an inverse kinematics: joints, or the reason why there are none.
pub(super) struct JointSolution {
    pub(super) joints: Slot<Real>,
    pub(super) width: u32,
    pub(super) reason: Slot<Int>,
    pub(super) joint: Slot<Int>,
}

impl JointSolution {
    pub(super) fn put(
        self,
        frame: &mut Frame<'_>,
        found: Option<Result<Joints, InverseKinematicsError>>,
    ) -> Option<()> {
        let (reason, joint) = match &found {
            Some(Ok(_)) => (0, 0),
            Some(Err(fault)) => (fault.reason(), fault.joint()),
            None => (NULL_INT, NULL_INT),
        };
        frame.put_joints(self.joints, self.width, found.and_then(Result::ok).as_ref())?;
        frame.put(self.reason, reason)?;
        frame.put(self.joint, joint)
    }
}

#[cfg(test)]
mod tests {
    use crate::frame::PrepareFault;
    use crate::testing::{PrimitiveHarness, kr6};

    const HOLD: [f64; 8] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

    #[test]
    fn the_pose_of_the_start_gives_the_joints_of_the_start() {
        let mut bench = PrimitiveHarness::new("InverseKinematics");
        bench.hold = Some(HOLD);
        bench.prepare().unwrap();
        let pose = bench.model.arm.unwrap().forward(&HOLD).to_slots();
        let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
        for (got, want) in joints.iter().zip(HOLD) {
            assert!((got - want).abs() < 1e-12, "{joints:?}");
        }
        assert_eq!((bench.int("reason"), bench.int("joint")), (0, 0));
    }

    #[test]
    fn an_unreachable_or_null_pose_gives_null() {
        let mut bench = PrimitiveHarness::new("InverseKinematics");
        bench.hold = Some(HOLD);
        bench.prepare().unwrap();
        let far = [9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let near = [0.0, 0.0, 0.3105 + 0.078, 0.0, 0.0, 0.0, 1.0];
        for (pose, reason) in [(far, 2), (near, 3), ([f64::NAN; 7], 1)] {
            let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
            assert!(joints.iter().all(|q| q.is_nan()));
            assert_eq!(bench.int("reason"), reason);
            assert_eq!(bench.int("joint"), 0);
        }
    }

    #[test]
    fn a_joint_beyond_its_limit_gives_null_and_is_named() {
        let mut bench = PrimitiveHarness::new("InverseKinematics");
        let arm = bench.model.arm.unwrap();
        let limit = bench.model.limits.upper[0];
        bench.hold = Some([limit - 0.01, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0]);
        bench.prepare().unwrap();
        // Rotated about the first axis, beyond its limit and beyond 180°: it must not switch to the other way round.
        for beyond in [0.02, 0.3] {
            let mut there = bench.hold.unwrap();
            there[0] = limit + beyond;
            let pose = arm.forward(&there).to_slots();
            let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
            assert!(joints.iter().all(|q| q.is_nan()));
            assert_eq!((bench.int("reason"), bench.int("joint")), (4, 1));
        }
    }

    #[test]
    fn the_pose_of_the_start_gives_its_joints_where_several_axes_are_aligned() {
        // Upright with a bent wrist, upright and straight, and the wrist above the shoulder.
        let beyond = -(1.0_f64.sin() * 0.39).atan2(0.4 + 0.39 * 1.0_f64.cos());
        for hold in [
            [0.7, 0.0, 0.4, 0.0, -0.9, 1.2, 0.3, 0.0],
            [0.7, 0.0, 0.4, 0.0, -0.9, 0.0, 0.3, 0.0],
            [0.7, 1e-12, 0.4, -1e-11, -0.9, 1.2, 0.3, 0.0],
            [0.7, beyond, 0.0, 1.0, -0.9, 1.2, 0.3, 0.0],
        ] {
            let mut bench = PrimitiveHarness::new("InverseKinematics");
            bench.hold = Some(hold);
            bench.prepare().unwrap();
            let pose = bench.model.arm.unwrap().forward(&hold).to_slots();
            let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
            for (got, want) in joints.iter().zip(hold) {
                assert!((got - want).abs() < 1e-9, "{joints:?} {hold:?}");
            }
        }
    }

    #[test]
    fn it_follows_an_arm_of_six_joints() {
        let mut bench = PrimitiveHarness::wide("InverseKinematics", None, 6);
        bench.model = kr6();
        let hold = [0.3, -1.2, 1.4, 3.1, 0.8, -4.0, 0.0, 0.0];
        bench.hold = Some(hold);
        bench.prepare().unwrap();
        // Joint 4 continues beyond 180°.
        for step in 0..100 {
            let mut there = hold;
            there[3] += 1e-3 * f64::from(step);
            let pose = kr6().arm.unwrap().forward(&there).to_slots();
            let joints = bench.set_reals("pose", &pose).step().reals("joints", 6);
            for (got, want) in joints.iter().zip(there) {
                assert!((got - want).abs() < 1e-9, "{joints:?}");
            }
        }
    }

    #[test]
    fn without_a_known_hold_position_it_cannot_become_ready() {
        let mut bench = PrimitiveHarness::new("InverseKinematics");
        bench.hold = None;
        assert_eq!(
            bench.prepare(),
            Err(PrepareFault::HoldUnknown { device: 0 })
        );
    }
}
