//! `JointState`: the measurements of an arm's joints, latched at the beginning of the cycle.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Kernel, Parameter, Port, PortType, Real, Slot, Spec, Step, UnitRule,
    operands,
};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointState",
        summary: "Measured joint positions and torques of an arm.",
        null: "null while the device is lost",
        undefined: "the device is lost",
        outputs: &[
            Port::new(
                "position",
                PortType::Joints,
                UnitRule::Joint(0),
                "measured joint positions, A1 first",
            ),
            Port::new(
                "hold",
                PortType::Joints,
                UnitRule::Joint(0),
                "set-point that the driver currently sends: a net's as it is played, or the driver's hold position",
            )
            .diagnostic(),
            Port::new(
                "torque",
                PortType::Joints,
                UnitRule::Is(Unit::NEWTON_METRE),
                "measured joint torques",
            )
            .diagnostic(),
            Port::new(
                "external_torque",
                PortType::Joints,
                UnitRule::Is(Unit::NEWTON_METRE),
                "joint torques not explained by the robot's dynamic model",
            )
            .diagnostic(),
        ],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointState>()],
);

operands! {
    struct JointState {
        position: Slot<Real>, hold: Slot<Real>, torque: Slot<Real>, external_torque: Slot<Real>, device: Device,
        width: u32,
    }
}

impl Step for JointState {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let measured = frame
            .measured(self.device)
            .map(|m| [m.position, m.hold, m.torque, m.external_torque]);
        let outputs = [self.position, self.hold, self.torque, self.external_torque];
        let Some(measured) = measured else {
            return outputs
                .into_iter()
                .try_for_each(|output| frame.put_joints(output, self.width, None));
        };
        let mut pairs = outputs.into_iter().zip(&measured);
        pairs.try_for_each(|(output, joints)| frame.put_joints(output, self.width, Some(joints)))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_latched_values_and_null_when_the_device_is_lost() {
        let mut bench = PrimitiveHarness::new("JointState");
        bench.device.measurement.position[6] = 0.7;
        bench.device.measurement.hold[0] = 0.1;
        assert_eq!(
            bench.step().reals("position", 7),
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.7]
        );
        assert_eq!(bench.real("hold"), 0.1);
        bench.device.present = false;
        assert!(
            bench
                .step()
                .reals("position", 7)
                .iter()
                .all(|value| value.is_nan())
        );
        assert!(
            bench
                .reals("external_torque", 7)
                .iter()
                .all(|value| value.is_nan())
        );
    }
}
