//! `Cross`: the cross product of two vectors, a × b.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Slot, Spec, Step, UnitRule, Vector3, operands,
};
use crate::types::Type;
use crate::vector;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Cross",
        summary: "The cross product of two vectors, right-handed.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "[a_y b_z - a_z b_y, a_z b_x - a_x b_z, a_x b_y - a_y b_x]",
        examples: &[Example::new(
            "x × y = z, and parallel vectors",
            "",
            "a | b | out\n\
             [1, 0, 0] | [0, 1, 0] | [0, 0, 1]\n\
             [0, 1, 0] | [1, 0, 0] | [0, 0, -1]\n\
             [1, 2, 3] | [-2, 1, 0.5] | [-2, -6.5, 5]\n\
             [1, 2, 3] | [2, 4, 6] | [0, 0, 0]\n\
             null | [2, 4, 6] | null",
        )],
        inputs: &[
            Port::new(
                "a",
                PortType::Is(Type::Vector3),
                UnitRule::Var(0),
                "first factor",
            ),
            Port::new(
                "b",
                PortType::Is(Type::Vector3),
                UnitRule::Var(1),
                "second factor, same axes",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Product(0, 1),
            "a × b, same axes",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Cross>()],
);

operands! {
    struct Cross { a: Slot<Vector3>, b: Slot<Vector3>, out: Slot<Vector3> }
}

impl Step for Cross {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let factors = frame.composite(self.a).zip(frame.composite(self.b));
        frame.put_composite(self.out, factors.map(|(a, b)| vector::cross(a, b)))
    }
}
