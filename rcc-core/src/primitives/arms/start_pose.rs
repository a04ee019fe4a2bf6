//! `StartPose`: the pose in which an arm's flange was held when the command was prepared, constant while the command
//! runs.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Kernel, Parameter, Port, Prepare, Real, Slot, Spec, StateSpec, Step,
    operands,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "StartPose",
        summary: "The pose of an arm's flange when the command starts: that of its hold set-point, the same in every cycle.",
        outputs: &[
            Port::typed("pose", Type::Pose, "flange in the arm's base").diagnostic(),
            Port::typed("world", Type::Pose, "flange in the world frame of the cell").diagnostic(),
        ],
        parameters: &[Parameter::arm()],
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
    struct StartPose { pose: Slot<Pose>, world: Slot<Pose>, device: Device, state: Slot<[Real; 7]> }
}

impl Step for StartPose {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
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
}
