//! `SplitWrench`: the two vectors of a wrench.

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
        name: "SplitWrench",
        summary: "The two vectors of a wrench: force and torque.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "known, and null",
            "",
            "in | force | torque\n\
             [1, 2, 3, -4, -5, -6] | [1, 2, 3] | [-4, -5, -6]\n\
             null | null | null",
        )],
        inputs: &[Port::typed("in", Type::Wrench, "a wrench")],
        outputs: &[
            Port::new(
                "force",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::NEWTON),
                "force, same axes",
            ),
            Port::new(
                "torque",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::NEWTON_METRE),
                "torque about the reference point, same axes",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<SplitWrench>()],
);

operands! {
    struct SplitWrench { input: Slot<Spatial>, force: Slot<Vector3>, torque: Slot<Vector3> }
}

impl Step for SplitWrench {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let parts = frame.composite(self.input).map(spatial::split);
        frame.put_composite(self.force, parts.map(|(force, _)| force))?;
        frame.put_composite(self.torque, parts.map(|(_, torque)| torque))
    }
}
