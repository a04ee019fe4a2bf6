//! `CartesianImpedanceCommand`: the set-point of an arm under Cartesian impedance control; a unique resource.
//!
//! The executor's guard and then the driver check each set-point: ranges, the rate of the stiffness, the wrench, and
//! that the controller runs this strategy. A null input sends no command, and the driver brings the arm to rest.

use crate::frame::Frame;
use crate::impedance::{ControlMode, Impedance};
use crate::joints::JOINTS_MAX;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Device, Kernel, Parameter, Port, PortType, Real, Role, Slot,
    Spatial, Spec, Step, UnitRule, Vector3, operands,
};
use crate::types::Type;
use crate::unit::Unit;

const fn axes(name: &'static str, unit: Unit, doc: &'static str) -> Port {
    Port::new(name, PortType::Is(Type::Vector3), UnitRule::Is(unit), doc)
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "CartesianImpedanceCommand",
        summary: "Commands an arm under Cartesian impedance control, a unique resource of this net: springs along and about the axes of the task frame hold the tool at the pose of `position`, and `wrench` is applied in addition.",
        null: "a null element of any input sends no command: the driver brings the arm to rest and removes the wrench",
        formula: "t = J^T (K (x_set - x) + D + F) (Schreiber, Stemmer, Bischoff, The Fast Research Interface for the KUKA \
                  Lightweight Robot, ICRA 2010 workshop)",
        inputs: &[
            Port::new(
                "position",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint set-point, A1 first; its flange pose is the equilibrium of the springs",
            ),
            axes(
                "stiffness",
                Unit::NEWTON.per(Unit::METRE),
                "along x, y, z of the task frame",
            ),
            axes(
                "rotational_stiffness",
                Unit::NEWTON_METRE.per(Unit::RADIAN),
                "about x, y, z of the task frame",
            ),
            axes("damping", Unit::ONE, "damping ratio along x, y, z")
                .default(DefaultValue::Real(0.7)),
            axes(
                "rotational_damping",
                Unit::ONE,
                "damping ratio about x, y, z",
            )
            .default(DefaultValue::Real(0.7)),
            Port::typed(
                "wrench",
                Type::Wrench,
                "force and torque that the tool applies in addition, axes of the task frame; if omitted, none",
            )
            .default(DefaultValue::Real(0.0)),
        ],
        parameters: &[Parameter::arm()],
        role: Role::CommandsArm,
        ..Spec::PLAIN
    },
    &[Kernel::each::<CartesianImpedanceCommand>()],
);

operands! {
    struct CartesianImpedanceCommand {
        position: Slot<Real>, stiffness: Slot<Vector3>, rotational_stiffness: Slot<Vector3>,
        damping: Slot<Vector3>, rotational_damping: Slot<Vector3>, wrench: Slot<Spatial>, device: Device,
        width: u32,
    }
}

impl Step for CartesianImpedanceCommand {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let command = frame.joints(self.position, self.width);
        let stiffness = (
            frame.composite(self.stiffness),
            frame.composite(self.rotational_stiffness),
        );
        let ratio = (
            frame.composite(self.damping),
            frame.composite(self.rotational_damping),
        );
        let (
            Some(position),
            (Some(along), Some(about)),
            (Some(damping), Some(turning)),
            Some(wrench),
        ) = (command, stiffness, ratio, frame.composite(self.wrench))
        else {
            return Some(());
        };
        if let Some(output) = frame.output(self.device) {
            output.has_position = true;
            output.position = position;
            output.impedance = Impedance {
                strategy: ControlMode::CartesianImpedance as u64,
                stiffness: six(along, about),
                damping: six(damping, turning),
                added: {
                    let [fx, fy, fz, tx, ty, tz] = wrench;
                    six([fx, fy, fz], [tx, ty, tz])
                },
            };
        }
        Some(())
    }
}

/// Elements along the axes, followed by those about them.
fn six([x, y, z]: [f64; 3], [rx, ry, rz]: [f64; 3]) -> [f64; JOINTS_MAX] {
    [x, y, z, rx, ry, rz, 0.0, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    const INPUTS: [(&str, usize); 6] = [
        ("position", 7),
        ("stiffness", 3),
        ("rotational_stiffness", 3),
        ("damping", 3),
        ("rotational_damping", 3),
        ("wrench", 6),
    ];

    fn bench() -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("CartesianImpedanceCommand");
        bench
            .set_reals("position", &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
            .set_reals("stiffness", &[100.0, 200.0, 300.0])
            .set_reals("rotational_stiffness", &[10.0, 20.0, 30.0])
            .set_reals("damping", &[0.4, 0.5, 0.6])
            .set_reals("rotational_damping", &[0.7, 0.8, 0.9])
            .set_reals("wrench", &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        bench
    }

    #[test]
    fn passes_position_springs_and_wrench_on() {
        let mut bench = bench();
        bench.step();
        assert!(bench.output.has_position);
        assert_eq!(bench.output.position[6], 0.7);
        let expected = Impedance {
            strategy: 1,
            stiffness: [100.0, 200.0, 300.0, 10.0, 20.0, 30.0, 0.0, 0.0],
            damping: [0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.0, 0.0],
            added: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0],
        };
        assert_eq!(bench.output.impedance, expected);
    }

    #[test]
    fn any_null_element_of_any_input_sends_no_command() {
        for (input, width) in INPUTS {
            for element in 0..width {
                let mut bench = bench();
                let mut values = [0.5; 7];
                values[element] = f64::NAN;
                bench.set_reals(input, &values[..width]).step();
                assert!(!bench.output.has_position, "{input} {element}");
                assert_eq!(bench.output.impedance, Impedance::NONE);
            }
        }
    }
}
