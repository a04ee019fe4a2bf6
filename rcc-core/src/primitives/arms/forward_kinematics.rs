//! `ForwardKinematics`: the pose of an arm's flange in its base, from joint positions.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Kernel, Parameter, Port, PortType, Real, Slot, Spec, Step, UnitRule,
    operands,
};
use crate::types::{NULL_REAL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ForwardKinematics",
        summary: "The flange pose for joint positions.",
        inputs: &[Port::new(
            "joints",
            PortType::Joints,
            UnitRule::Joint(0),
            "joint positions, A1 first",
        )],
        outputs: &[Port::typed("pose", Type::Pose, "flange in the arm's base")],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<ForwardKinematics>()],
);

operands! {
    struct ForwardKinematics { joints: Slot<Real>, pose: Slot<Pose>, device: Device, width: u32 }
}

impl Step for ForwardKinematics {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let flange = match (
            frame.arm(self.device),
            frame.joints(self.joints, self.width),
        ) {
            (Some(arm), Some(joints)) => arm.forward(&joints),
            _ => Pose::from_slots([NULL_REAL; 7]),
        };
        frame.put(self.pose, flange)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn the_upright_arm_is_as_high_as_its_lengths() {
        let mut bench = PrimitiveHarness::new("ForwardKinematics");
        let pose = bench.set_reals("joints", &[0.0; 7]).step().reals("pose", 7);
        for (got, want) in pose.iter().zip([0.0, 0.0, 1.1785, 0.0, 0.0, 0.0, 1.0]) {
            assert!((got - want).abs() < 1e-15, "{pose:?}");
        }
    }

    #[test]
    fn null_makes_every_element_null() {
        let mut bench = PrimitiveHarness::new("ForwardKinematics");
        bench.set_reals("joints", &[0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0]);
        assert!(
            bench
                .step()
                .reals("pose", 7)
                .iter()
                .all(|value| value.is_nan())
        );
    }
}
