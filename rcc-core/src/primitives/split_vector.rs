//! `SplitVector`: the three numbers of a vector.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::types::{NULL_REAL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SplitVector",
        summary: "The three elements of a vector.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "elements in order",
            "",
            "in | x | y | z\n\
             [1, -2, 3.5] | 1 | -2 | 3.5\n\
             null | null | null | null",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Is(Type::Vector3),
            UnitRule::Var(0),
            "`[x y z]`",
        )],
        outputs: &[
            Port::real("x", UnitRule::Var(0), "element along x"),
            Port::real("y", UnitRule::Var(0), "element along y"),
            Port::real("z", UnitRule::Var(0), "element along z"),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [input, x, y, z]: [u32; 4]) {
    let elements = frame.composite(input).unwrap_or([NULL_REAL; 3]);
    for (slot, element) in [x, y, z].into_iter().zip(elements) {
        frame.set_real(slot, element);
    }
}
