//! `MakeTwist`: a twist from its two vectors.

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
        name: "MakeTwist",
        summary: "A twist from the velocity of the reference point and the angular velocity.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "known, and null",
            "",
            "linear | angular | out\n\
             [1, 2, 3] | [-4, -5, -6] | [1, 2, 3, -4, -5, -6]\n\
             [1, 2, 3] | null | null\n\
             null | [1, 2, 3] | null",
        )],
        inputs: &[
            Port::new(
                "linear",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "velocity of the reference point",
            ),
            Port::new(
                "angular",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::RADIAN_PER_SECOND),
                "angular velocity, same axes",
            ),
        ],
        outputs: &[Port::typed("out", Type::Twist, "twist, same axes")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<MakeTwist>()],
);

operands! {
    struct MakeTwist { linear: Slot<Vector3>, angular: Slot<Vector3>, out: Slot<Spatial> }
}

impl Step for MakeTwist {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let parts = frame
            .composite(self.linear)
            .zip(frame.composite(self.angular));
        frame.put_composite(
            self.out,
            parts.map(|(linear, angular)| spatial::join(linear, angular)),
        )
    }
}
