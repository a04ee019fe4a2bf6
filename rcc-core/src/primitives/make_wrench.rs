//! `MakeWrench`: a wrench from its two vectors.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::spatial;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MakeWrench",
        summary: "A wrench from a force and a torque.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "known, and null",
            "",
            "force | torque | out\n\
             [1, 2, 3] | [-4, -5, -6] | [1, 2, 3, -4, -5, -6]\n\
             [1, 2, 3] | null | null\n\
             null | [1, 2, 3] | null",
        )],
        inputs: &[
            Port::new(
                "force",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::NEWTON),
                "force",
            ),
            Port::new(
                "torque",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::NEWTON_METRE),
                "torque about the reference point, same axes",
            ),
        ],
        outputs: &[Port::typed("out", Type::Wrench, "wrench, same axes")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [force, torque, out]: [u32; 3]) {
    let parts = frame.composite(force).zip(frame.composite(torque));
    frame.set_composite(
        out,
        parts.map(|(force, torque)| spatial::join(force, torque)),
    );
}
