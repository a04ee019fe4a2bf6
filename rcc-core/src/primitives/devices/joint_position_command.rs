//! `JointPositionCommand`: the set-point of an arm's joints; a unique resource.
//!
//! The executor's guard and then the driver check each set-point. A null input sends no command, and the driver brings
//! the arm to rest; it never repeats the last set-point.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Kernel, Parameter, Port, PortType, Real, Role, Slot, Spec, Step,
    UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointPositionCommand",
        summary: "Commands the joint positions of an arm, a unique resource of this net.",
        null: "a null element sends no command: the driver brings the arm to rest",
        inputs: &[Port::new(
            "position",
            PortType::Joints,
            UnitRule::Joint(0),
            "joint set-point, A1 first",
        )],
        parameters: &[Parameter::arm()],
        role: Role::CommandsArm,
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointPositionCommand>()],
);

operands! {
    struct JointPositionCommand { position: Slot<Real>, device: Device, width: u32 }
}

impl Step for JointPositionCommand {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let command = frame.joints(self.position, self.width);
        if let (Some(output), Some(position)) = (frame.output(self.device), command) {
            output.has_position = true;
            output.position = position;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn passes_a_whole_vector_on() {
        let mut bench = PrimitiveHarness::new("JointPositionCommand");
        bench
            .set_reals("position", &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
            .step();
        assert!(bench.output.has_position);
        assert_eq!(
            bench.output.position,
            [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.0]
        );
    }

    #[test]
    fn any_null_element_sends_no_command() {
        for joint in 0..7 {
            let mut bench = PrimitiveHarness::new("JointPositionCommand");
            let mut position = [0.1; 7];
            position[joint] = f64::NAN;
            bench.set_reals("position", &position).step();
            assert!(!bench.output.has_position);
        }
    }
}
