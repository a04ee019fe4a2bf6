//! `MakeWrench`: a wrench from its two vectors.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Slot, Spatial, Spec, Step, UnitRule, Vector3,
    operands,
};
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
    &[Kernel::each::<MakeWrench>()],
);

operands! {
    struct MakeWrench { force: Slot<Vector3>, torque: Slot<Vector3>, out: Slot<Spatial> }
}

impl Step for MakeWrench {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let parts = frame
            .composite(self.force)
            .zip(frame.composite(self.torque));
        frame.put_composite(
            self.out,
            parts.map(|(force, torque)| spatial::join(force, torque)),
        )
    }
}
