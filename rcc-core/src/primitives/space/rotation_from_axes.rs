//! `RotationFromAxes`: a rotation from the direction of its x axis and the side of its y axis.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Rotation, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::rotation;
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationFromAxes",
        summary: "The rotation whose x axis points along a vector and whose y axis is in the half plane of another.",
        undefined: "a zero vector; parallel or opposite vectors (to 1e-9 rad); overflow: an infinite input",
        formula: "columns x/|x|, z × x and z = x × y / |x × y|",
        examples: &[Example::new(
            "the axes of a frame",
            "",
            "x | y | out\n\
             [0, 3, 0] | [-2, 5, 0] | {rpy: [0, 0, deg(90)]}\n\
             [1, 0, 0] | [7, 0, 2] | {rpy: [deg(90), 0, 0]}\n\
             [1, 0, 0] | [-7, 0, 0] | null\n\
             [1, 0, 0] | null | null",
        )],
        inputs: &[
            Port::new(
                "x",
                PortType::Is(Type::Vector3),
                UnitRule::Var(0),
                "direction of the x axis of B, in axes of A",
            ),
            Port::new(
                "y",
                PortType::Is(Type::Vector3),
                UnitRule::Var(1),
                "half plane of the y axis of B, in axes of A; need not be perpendicular to x",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Rotation,
            "rotation of B in A, w ≥ 0",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromAxes>()],
);

operands! {
    struct RotationFromAxes { x: Slot<Vector3>, y: Slot<Vector3>, out: Slot<Rotation> }
}

impl Step for RotationFromAxes {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let axes = frame.composite(self.x).zip(frame.composite(self.y));
        let rotation = axes.and_then(|(x, y)| rotation::from_axes(x, y));
        frame.put_composite(self.out, rotation)
    }
}
