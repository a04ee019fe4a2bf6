//! `WrenchShift`: moves the reference point of a wrench.

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
        name: "WrenchShift",
        summary: "The same load, as a wrench with another reference point, in the same axes.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "f' = f, t' = t - by × f (Lynch and Park, Modern Robotics, 2017, section 3.4)",
        examples: &[Example::new(
            "10 N down at the origin has a torque about a point half a metre along x",
            "",
            "in | by | out\n\
             [0, 0, -10, 0, 0, 0] | [0.5, 0, 0] | [0, 0, -10, 0, -5, 0]\n\
             [10, -5, 2, 0.3, 0.1, -0.2] | [0, 0, 0] | [10, -5, 2, 0.3, 0.1, -0.2]\n\
             null | [0, 0, 0] | null",
        )],
        inputs: &[
            Port::typed("in", Type::Wrench, "a wrench"),
            Port::new(
                "by",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "vector from the old reference point to the new one, same axes",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Wrench,
            "the wrench at the new reference point, same axes",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<WrenchShift>()],
);

operands! {
    struct WrenchShift { input: Slot<Spatial>, by: Slot<Vector3>, out: Slot<Spatial> }
}

impl Step for WrenchShift {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let both = frame.composite(self.input).zip(frame.composite(self.by));
        frame.put_composite(
            self.out,
            both.map(|(wrench, by)| spatial::shift_wrench(wrench, by)),
        )
    }
}
