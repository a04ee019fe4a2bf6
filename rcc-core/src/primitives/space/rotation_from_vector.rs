//! `RotationFromVector`: a rotation from its rotation vector, the exponential map.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Rotation, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationFromVector",
        summary: "The rotation about the direction of a vector by its length: the exponential map.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "q = [sin(a/2) in/a, cos(a/2)] with a = |in|, a series near 0 (Grassia, J. Graphics Tools 3(3), 1998)",
        examples: &[Example::new(
            "oblique (scipy 1.17), and zero",
            "",
            "in | out\n\
             [0.4, -0.7, 1.1] | {quat: [0.18485641079320972, -0.323498718888117, 0.5083551296813268, 0.7763708832723447]}\n\
             [0, 0, 0] | {quat: [0, 0, 0, 1]}\n\
             [1e-300, 0, 0] | {quat: [0, 0, 0, 1]}\n\
             null | null",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Is(Type::Vector3),
            UnitRule::Is(Unit::RADIAN),
            "axis × angle",
        )],
        outputs: &[Port::typed(
            "out",
            Type::Rotation,
            "rotation of B in A; the axis is the same in both",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromVector>()],
);

operands! {
    struct RotationFromVector { input: Slot<Vector3>, out: Slot<Rotation> }
}

impl Step for RotationFromVector {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let rotation = frame.composite(self.input).map(rotation::exp);
        frame.put_composite(self.out, rotation)
    }
}
