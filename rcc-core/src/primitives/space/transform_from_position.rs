//! `TransformFromPosition`: the homogeneous transform of a frame with a variable position and a constant rotation.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, ParameterKind, Port, PortType, Real, Slot, Spec,
    Step, UnitRule, operands,
};
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "TransformFromPosition",
        summary: "The homogeneous transform of a frame at a position, with a constant rotation.",
        examples: &[Example::new(
            "a translation",
            "{rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}",
            "x | y | z | out
             1.5 | 2.5 | 3.5 | [[1, 0, 0, 1.5], [0, 1, 0, 2.5], [0, 0, 1, 3.5], [0, 0, 0, 1]]",
        )],
        inputs: &[
            Port::real("x", UnitRule::Var(0), "origin of frame B in frame A"),
            Port::real("y", UnitRule::Var(0), "origin of frame B in frame A"),
            Port::real("z", UnitRule::Var(0), "origin of frame B in frame A"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::TRANSFORM),
            UnitRule::Var(0),
            "transform of B in A, row-major; its last column is the position",
        )],
        parameters: &[Parameter::new(
            "rotation",
            ParameterKind::Value(PortType::Is(Type::Matrix(3, 3)), UnitRule::Is(Unit::ONE)),
            "rotation matrix of B in A by rows: its columns are the axes of B in A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TransformFromPosition>()],
);

operands! {
    struct TransformFromPosition {
        x: Slot<Real>, y: Slot<Real>, z: Slot<Real>, out: Slot<[Real; 16]>, rotation: Slot<[Real; 9]>,
    }
}

impl Step for TransformFromPosition {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let [a, b, c, d, e, f, g, h, i] = frame.get(self.rotation)?;
        let (x, y, z) = (frame.get(self.x)?, frame.get(self.y)?, frame.get(self.z)?);
        let null = x.is_nan() | y.is_nan() | z.is_nan();
        let transform = [a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0];
        frame.put(self.out, if null { [NULL_REAL; 16] } else { transform })
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn the_position_is_the_last_column() {
        let mut bench = PrimitiveHarness::new("TransformFromPosition");
        bench.set_reals("rotation", &[0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        bench
            .set_real("x", 1.0)
            .set_real("y", 2.0)
            .set_real("z", 3.0);
        let out = bench.step().reals("out", 16);
        assert_eq!(out[..8], [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0]);
        assert_eq!(out[8..], [0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn null_makes_every_element_null() {
        let mut bench = PrimitiveHarness::new("TransformFromPosition");
        bench.set_reals("rotation", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        bench.set_real("x", 1.0).set_real("y", 2.0);
        assert!(
            bench
                .step()
                .reals("out", 16)
                .iter()
                .all(|value| value.is_nan())
        );
    }
}
