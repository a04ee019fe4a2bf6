//! `SplitTwist`: the two vectors of a twist.

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
        name: "SplitTwist",
        summary: "The two vectors of a twist: velocity of the reference point and angular velocity.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "known, and null",
            "",
            "in | linear | angular\n\
             [1, 2, 3, -4, -5, -6] | [1, 2, 3] | [-4, -5, -6]\n\
             null | null | null",
        )],
        inputs: &[Port::typed("in", Type::Twist, "a twist")],
        outputs: &[
            Port::new(
                "linear",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "velocity of the reference point, same axes",
            ),
            Port::new(
                "angular",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::RADIAN_PER_SECOND),
                "angular velocity, same axes",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<SplitTwist>()],
);

operands! {
    struct SplitTwist { input: Slot<Spatial>, linear: Slot<Vector3>, angular: Slot<Vector3> }
}

impl Step for SplitTwist {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let parts = frame.composite(self.input).map(spatial::split);
        frame.put_composite(self.linear, parts.map(|(linear, _)| linear))?;
        frame.put_composite(self.angular, parts.map(|(_, angular)| angular))
    }
}
