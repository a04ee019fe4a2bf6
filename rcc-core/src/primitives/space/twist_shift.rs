//! `TwistShift`: moves the reference point of a twist.

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
        name: "TwistShift",
        summary: "The same motion, as a twist with another reference point, in the same axes.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "v' = v + ω × by, ω' = ω (Lynch and Park, Modern Robotics, 2017, section 3.3.2)",
        examples: &[Example::new(
            "2 rad/s about z: half a metre along x moves along y with 1 m/s",
            "",
            "in | by | out\n\
             [0, 0, 0, 0, 0, 2] | [0.5, 0, 0] | [0, 1, 0, 0, 0, 2]\n\
             [0.1, 0.2, -0.3, 0.5, -0.4, 0.6] | [0, 0, 0] | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6]\n\
             null | [0, 0, 0] | null",
        )],
        inputs: &[
            Port::typed("in", Type::Twist, "a twist"),
            Port::new(
                "by",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "vector from the old reference point to the new one, same axes",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Twist,
            "the twist at the new reference point, same axes",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TwistShift>()],
);

operands! {
    struct TwistShift { input: Slot<Spatial>, by: Slot<Vector3>, out: Slot<Spatial> }
}

impl Step for TwistShift {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let both = frame.composite(self.input).zip(frame.composite(self.by));
        frame.put_composite(
            self.out,
            both.map(|(twist, by)| spatial::shift_twist(twist, by)),
        )
    }
}
