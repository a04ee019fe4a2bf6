//! `RotationFromAxisAngle`: a rotation about an axis by an angle.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Rotation, Slot, Spec, Step, UnitRule,
    Vector3, operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationFromAxisAngle",
        summary: "The rotation about the direction of an axis by an angle, right-handed.",
        undefined: "the zero vector as axis; overflow: an infinite input",
        formula: "q = [sin(angle/2) axis/|axis|, cos(angle/2)] (Solà, arXiv:1711.02508, section 2)",
        examples: &[Example::new(
            "about an oblique axis (scipy 1.17)",
            "",
            "axis | angle | out\n\
             [1, 2, 2] | 0.9 | {quat: [0.14498851137041008, 0.28997702274082016, 0.28997702274082016, 0.9004471023526769]}\n\
             [0, 0, 5] | deg(90) | {rpy: [0, 0, deg(90)]}\n\
             [0, 0, 0] | 0.9 | null\n\
             [1, 2, 2] | null | null",
        )],
        inputs: &[
            Port::new(
                "axis",
                PortType::Is(Type::Vector3),
                UnitRule::Var(0),
                "axis, any length except 0",
            ),
            Port::real("angle", UnitRule::Is(Unit::RADIAN), "angle about it"),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Rotation,
            "rotation of B in A; the axis is the same in both",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromAxisAngle>()],
);

operands! {
    struct RotationFromAxisAngle { axis: Slot<Vector3>, angle: Slot<Real>, out: Slot<Rotation> }
}

impl Step for RotationFromAxisAngle {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let angle = frame.get(self.angle)?;
        let axis = frame.composite(self.axis);
        let rotation = axis.and_then(|axis| rotation::from_axis_angle(axis, angle));
        frame.put_composite(self.out, rotation)
    }
}
