//! `Normalize`: the unit vector in the direction of a vector.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [input, out]: [u32; 2]) {
    let direction = frame.composite(input).and_then(vector::normalized);
    frame.set_composite(out, direction);
}
