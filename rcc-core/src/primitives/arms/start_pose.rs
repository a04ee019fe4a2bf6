//! `StartPose`: the pose in which an arm's flange was held when the command was prepared, or at which its net takes the arm
//! over; constant while the command runs.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Int, Kernel, Parameter, Port, Prepare, Real, Slot, Spec, StateSpec,
    Step, operands,
};
use crate::primitives::start;
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "StartPose",
        summary: "The pose of an arm's flange when the command starts: that of its hold set-point, or where `start: continue` begins; the same in every cycle.",
        outputs: &[
            Port::typed("pose", Type::Pose, "flange in the arm's base").diagnostic(),
            Port::typed("world", Type::Pose, "flange in the world frame of the cell").diagnostic(),
        ],
        parameters: &[
            Parameter::arm(),
            start::parameter(
                "hold: where the arm is held at LOAD or START; continue: the last set-point of the net from which a hand-over or a rule \
                 takes the arm, and otherwise where the arm is held then",
            ),
        ],
        // both poses
        state: StateSpec {
            reals: 14,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<StartPose>()],
)
.prepared_by::<StartPose>();

impl Prepare for StartPose {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let (arm, hold) = preparation.arm_at_rest(self.device)?;
        let model = preparation.models.get(self.device.0 as usize);
        let base = model.map_or(Pose::NULL, |model| model.base);
        let pose = arm.forward(&hold);
        let world = base.compose(&pose);
        preparation.put(self.state, pose.to_slots());
        preparation.put(self.state + 7, world.to_slots());
        Ok(())
    }
}

operands! {
    struct StartPose { pose: Slot<Pose>, world: Slot<Pose>, device: Device, start: Slot<Int>, state: Slot<[Real; 7]> }
}

impl StartPose {
    /// In the first cycle with `start: continue`, takes the pose of the motion that the arm is in.
    fn take_over(self, frame: &mut Frame<'_>) -> Option<()> {
        let taken = start::taken_over(frame, self.device, self.start)?;
        let model = frame.models.get(self.device.0 as usize);
        let Some((model, motion)) = model.zip(taken) else {
            return Some(());
        };
        let Some(arm) = &model.arm else {
            return Some(());
        };
        let pose = arm.forward(&motion.position);
        let world = model.base.compose(&pose);
        frame.put(self.state, pose.to_slots())?;
        frame.put(self.state + 7, world.to_slots())
    }
}

impl Step for StartPose {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        self.take_over(frame)?;
        for (from, to) in [(self.state, self.pose), (self.state + 7, self.world)] {
            let known = frame.get(from)?;
            frame.put(to.cast(), known)?;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::ArmMotion;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn it_stays_where_the_arm_was_held() {
        let mut bench = PrimitiveHarness::new("StartPose");
        let hold = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];
        bench.hold = Some(hold);
        bench.model.base = Pose::from_xyz_rpy([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        bench.prepare().unwrap();
        let start: [f64; 7] = bench.step().reals("pose", 7).try_into().unwrap();
        let pose = Pose::from_slots(start);
        let world = bench.model.base.compose(&pose).to_slots();
        bench.device.measurement.position = [0.0; 8];
        assert_eq!(bench.step().reals("pose", 7), start);
        assert_eq!(bench.reals("world", 7), world);
        bench.hold = None;
        assert!(bench.prepare().is_err());
    }

    #[test]
    fn it_is_where_its_net_takes_the_arm_over() {
        let mut bench = PrimitiveHarness::new("StartPose");
        bench.prepare().unwrap();
        let hold = bench.hold.unwrap();
        let there = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];
        bench.arm = Some(ArmMotion::at_rest(there));
        bench.model.base = Pose::from_xyz_rpy([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let arm = bench.model.arm.unwrap();
        for (begins, joints) in [(0, hold), (start::CONTINUE, there)] {
            bench.cycle = 0;
            bench.set_int("start", begins);
            let pose = arm.forward(&joints);
            assert_eq!(bench.step().reals("pose", 7), pose.to_slots());
            // Only the first cycle takes over.
            bench.arm = Some(ArmMotion::at_rest([1.0; 8]));
            assert_eq!(bench.step().reals("pose", 7), pose.to_slots());
            bench.arm = Some(ArmMotion::at_rest(there));
        }
        let world = bench.model.base.compose(&arm.forward(&there));
        assert_eq!(bench.reals("world", 7), world.to_slots());
    }
}
