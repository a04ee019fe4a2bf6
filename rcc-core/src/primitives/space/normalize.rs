//! `Normalize`: the unit vector in the direction of a vector.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Slot, Spec, Step, UnitRule, Vector3, operands,
};
use crate::types::Type;
use crate::unit::Unit;
use crate::vector;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Normalize",
        summary: "The unit vector in the direction of a vector: the vector divided by its length.",
        undefined: "the zero vector; overflow: an infinite input",
        formula: "in / |in|, scaled by its largest element first so that no square overflows",
        examples: &[Example::new(
            "any length, and zero",
            "",
            "in | out\n\
             [3, 0, -4] | [0.6, 0, -0.8]\n\
             [3e200, 0, -4e200] | [0.6, 0, -0.8]\n\
             [0, 0, 0] | null\n\
             null | null",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Is(Type::Vector3),
            UnitRule::Var(0),
            "vector that is not zero",
        )],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Is(Unit::ONE),
            "unit vector, same axes",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Normalize>()],
);

operands! {
    struct Normalize { input: Slot<Vector3>, out: Slot<Vector3> }
}

impl Step for Normalize {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let direction = frame.composite(self.input).and_then(vector::normalized);
        frame.put_composite(self.out, direction)
    }
}
