//! `JointImpedanceCommand`: the set-point of an arm under joint impedance control; a unique resource.
//!
//! The executor's guard and then the driver check each set-point: ranges, the rate of the stiffness, the torque, and
//! that the controller runs this strategy. A null input sends no command, and the driver brings the arm to rest.

use crate::frame::Frame;
use crate::impedance::{ControlMode, Impedance};
use crate::primitive::{
    CatalogueEntry, DefaultValue, Device, Kernel, Parameter, Port, PortType, Real, Role, Slot,
    Spec, Step, UnitRule, operands,
};
use crate::unit::Unit;

const fn joints(name: &'static str, unit: Unit, doc: &'static str) -> Port {
    Port::new(name, PortType::Joints, UnitRule::Is(unit), doc)
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointImpedanceCommand",
        summary: "Commands an arm under joint impedance control, a unique resource of this net: a spring holds each joint at its position, and `torque` is applied in addition.",
        null: "a null element of any input sends no command: the driver brings the arm to rest and removes the torque",
        formula: "t = K (q_set - q) + D + t_add (Schreiber, Stemmer, Bischoff, The Fast Research Interface for the KUKA \
                  Lightweight Robot, ICRA 2010 workshop)",
        inputs: &[
            joints("position", Unit::RADIAN, "joint set-point, A1 first"),
            joints(
                "stiffness",
                Unit::NEWTON_METRE.per(Unit::RADIAN),
                "stiffness of each joint, A1 first",
            ),
            joints("damping", Unit::ONE, "damping ratio of each joint")
                .default(DefaultValue::Real(0.7)),
            joints(
                "torque",
                Unit::NEWTON_METRE,
                "torque that each joint applies in addition; if omitted, none",
            )
            .default(DefaultValue::Real(0.0)),
        ],
        parameters: &[Parameter::arm()],
        role: Role::CommandsArm,
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointImpedanceCommand>()],
);

operands! {
    struct JointImpedanceCommand {
        position: Slot<Real>, stiffness: Slot<Real>, damping: Slot<Real>, torque: Slot<Real>, device: Device,
        width: u32,
    }
}

impl Step for JointImpedanceCommand {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let of = |slot| frame.joints(slot, self.width);
        let (Some(position), Some(stiffness), Some(damping), Some(added)) = (
            of(self.position),
            of(self.stiffness),
            of(self.damping),
            of(self.torque),
        ) else {
            return Some(());
        };
        if let Some(output) = frame.output(self.device) {
            output.has_position = true;
            output.position = position;
            output.impedance = Impedance {
                strategy: ControlMode::JointImpedance as u64,
                stiffness,
                damping,
                added,
            };
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    fn bench() -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("JointImpedanceCommand");
        bench
            .set_reals("position", &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
            .set_reals(
                "stiffness",
                &[100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0],
            )
            .set_reals("damping", &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
            .set_reals("torque", &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        bench
    }

    #[test]
    fn passes_position_springs_and_torques_on() {
        let mut bench = bench();
        bench.step();
        assert!(bench.output.has_position);
        let expected = Impedance {
            strategy: 2,
            stiffness: [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 0.0],
            damping: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.0],
            added: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0],
        };
        assert_eq!(bench.output.impedance, expected);
        assert_eq!(
            bench.output.position[..7],
            [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
        );
    }

    #[test]
    fn any_null_element_of_any_input_sends_no_command() {
        for input in ["position", "stiffness", "damping", "torque"] {
            for joint in 0..7 {
                let mut bench = bench();
                let mut values = [0.5; 7];
                values[joint] = f64::NAN;
                bench.set_reals(input, &values).step();
                assert!(!bench.output.has_position, "{input} {joint}");
                assert_eq!(bench.output.impedance, Impedance::NONE);
            }
        }
    }
}
