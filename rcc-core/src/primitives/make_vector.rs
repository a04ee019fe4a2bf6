//! `MakeVector`: a vector from three numbers of the same unit.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MakeVector",
        summary: "A vector from its three elements.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "elements in order",
            "",
            "x | y | z | out\n\
             1 | -2 | 3.5 | [1, -2, 3.5]\n\
             1 | null | 3.5 | null",
        )],
        inputs: &[
            Port::real("x", UnitRule::Var(0), "element along x"),
            Port::real("y", UnitRule::Var(0), "element along y"),
            Port::real("z", UnitRule::Var(0), "element along z"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Var(0),
            "`[x y z]`",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [x, y, z, out]: [u32; 4]) {
    let vector = [x, y, z].map(|slot| frame.real(slot));
    frame.set_composite(out, Some(vector));
}
