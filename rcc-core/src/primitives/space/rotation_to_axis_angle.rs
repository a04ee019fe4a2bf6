//! `RotationToAxisAngle`: axis and angle of a rotation.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Rotation, Slot, Spec, Step, UnitRule,
    Vector3, operands,
};
use crate::rotation;
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationToAxisAngle",
        summary: "The unit axis and the angle of a rotation.",
        undefined: "overflow: a quaternion that cannot be normalized",
        formula: "angle = 2 atan2(|u|, w) for q = [u, w] with w >= 0; at 180° both axes are valid, and the one with a positive last nonzero element is returned",
        examples: &[Example::new(
            "oblique (scipy 1.17), 180° and no rotation",
            "",
            "in | axis | angle\n\
             {rpy: [0.3, -0.5, 1.2]} | [0.4036433731391749, -0.18823502542629336, 0.8953432875291975] | 1.3844660788463787\n\
             {quat: [0, -1, 0, 0]} | [0, 1, 0] | deg(180)\n\
             {quat: [0, 0, 0, 1]} | [0, 0, 1] | 0\n\
             null | null | null",
        )],
        inputs: &[Port::typed("in", Type::Rotation, "rotation of B in A")],
        outputs: &[
            Port::new(
                "axis",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::ONE),
                "unit axis, the same in A and B; z for no rotation",
            ),
            Port::real("angle", UnitRule::Is(Unit::RADIAN), "angle about it")
                .within(0.0, core::f64::consts::PI),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationToAxisAngle>()],
);

operands! {
    struct RotationToAxisAngle { input: Slot<Rotation>, axis: Slot<Vector3>, angle: Slot<Real> }
}

impl Step for RotationToAxisAngle {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let turn = frame.rotation(self.input).map(rotation::to_axis_angle);
        frame.put_composite(self.axis, turn.map(|(axis, _)| axis))?;
        frame.put(self.angle, turn.map_or(NULL_REAL, |(_, angle)| angle))
    }
}
