//! `RotationFromQuaternion`: a rotation from the four numbers of a quaternion.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Rotation, Slot, Spec, Step, UnitRule, operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationFromQuaternion",
        summary: "A rotation from a quaternion of any length except 0.",
        undefined: "all four zero (or so small or large that their squares underflow or overflow); overflow: an infinite input",
        formula: "q / |q|; Hamilton, ij = k (Solà, arXiv:1711.02508, table 1)",
        examples: &[Example::new(
            "normalization",
            "",
            "x | y | z | w | out\n\
             0 | 0 | 0 | 2 | {quat: [0, 0, 0, 1]}\n\
             0 | 3 | 0 | 4 | {quat: [0, 0.6, 0, 0.8]}\n\
             0 | 0 | 0 | 0 | null\n\
             0 | 3 | null | 4 | null",
        )],
        inputs: &[
            Port::real("x", UnitRule::Is(Unit::ONE), "factor of i"),
            Port::real("y", UnitRule::Is(Unit::ONE), "factor of j"),
            Port::real("z", UnitRule::Is(Unit::ONE), "factor of k"),
            Port::real("w", UnitRule::Is(Unit::ONE), "real part"),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Rotation,
            "rotation of B in A, normalized, with the sign of the input",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromQuaternion>()],
);

operands! {
    struct RotationFromQuaternion { x: Slot<Real>, y: Slot<Real>, z: Slot<Real>, w: Slot<Real>, out: Slot<Rotation> }
}

impl Step for RotationFromQuaternion {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let [x, y, z] = [frame.get(self.x)?, frame.get(self.y)?, frame.get(self.z)?];
        let quaternion = [x, y, z, frame.get(self.w)?];
        frame.put_composite(self.out, rotation::unit(quaternion))
    }
}
