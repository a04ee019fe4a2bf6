//! `RotationFromTwoVectors`: the shortest rotation from one direction to another.

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
        name: "RotationFromTwoVectors",
        summary: "The shortest rotation that turns the direction of one vector into that of another.",
        undefined: "a zero vector; opposite directions (to 1e-9 rad), for which every perpendicular axis is valid; overflow: an infinite input",
        formula: "q = [a × b, |a + b|² / 2] of the directions, normalized",
        examples: &[Example::new(
            "oblique (numpy, scipy 1.17), and opposite",
            "",
            "from | to | out\n\
             [1, 2, 3] | [-2, 1, 0.5] | {quat: [-0.1521805434638608, -0.4945867662575477, 0.3804513586596521, 0.7664735980632148]}\n\
             [0, 0, 2] | [0, 0, 3] | {quat: [0, 0, 0, 1]}\n\
             [0, 0, 2] | [0, 0, -3] | null\n\
             [0, 0, 0] | [0, 0, 1] | null\n\
             null | [0, 0, 1] | null",
        )],
        inputs: &[
            Port::new(
                "from",
                PortType::Is(Type::Vector3),
                UnitRule::Var(0),
                "vector, not zero",
            ),
            Port::new(
                "to",
                PortType::Is(Type::Vector3),
                UnitRule::Var(1),
                "vector, not zero, same axes",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Rotation,
            "rotation, in these axes; its axis is perpendicular to both vectors",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromTwoVectors>()],
);

operands! {
    struct RotationFromTwoVectors { from: Slot<Vector3>, to: Slot<Vector3>, out: Slot<Rotation> }
}

impl Step for RotationFromTwoVectors {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let vectors = frame.composite(self.from).zip(frame.composite(self.to));
        let turn = vectors.and_then(|(from, to)| rotation::between(from, to));
        frame.put_composite(self.out, turn)
    }
}
