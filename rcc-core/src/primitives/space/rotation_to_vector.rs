//! `RotationToVector`: the rotation vector of a rotation, the logarithm.

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
        name: "RotationToVector",
        summary: "The rotation vector of a rotation, axis × angle: the logarithm.",
        undefined: "overflow: a quaternion that cannot be normalized",
        formula: "2 atan2(|u|, w) u/|u| for q = [u, w] with w >= 0; at 180° always the same one of the two vectors is returned",
        examples: &[Example::new(
            "oblique (scipy 1.17), 180° and no rotation",
            "",
            "in | out\n\
             {rpy: [0.3, -0.5, 1.2]} | [0.5588305580623192, -0.26060500755348875, 1.2395724105069739]\n\
             {quat: [1, 0, 0, 0]} | [3.141592653589793, 0, 0]\n\
             {quat: [-1, 0, 0, 0]} | [3.141592653589793, 0, 0]\n\
             {quat: [0, 0, 0, 1]} | [0, 0, 0]\n\
             null | null",
        )],
        inputs: &[Port::typed("in", Type::Rotation, "rotation of B in A")],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Is(Unit::RADIAN),
            "axis × angle, length at most π; the same in A and B",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationToVector>()],
);

operands! {
    struct RotationToVector { input: Slot<Rotation>, out: Slot<Vector3> }
}

impl Step for RotationToVector {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let vector = frame.rotation(self.input).map(rotation::log);
        frame.put_composite(self.out, vector)
    }
}
