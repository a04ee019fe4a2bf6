//! `TransformPoint`: a point of an inner frame, expressed in the outer frame.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Slot, Spec, Step, UnitRule, Vector3, operands,
};
use crate::types::Type;
use crate::unit::Unit;
use crate::{rotation, vector};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "TransformPoint",
        summary: "A point of an inner frame, expressed in the outer frame.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "R point + p",
        examples: &[Example::new(
            "rotation and translation (scipy 1.17)",
            "",
            "pose | point | out\n\
             {xyz: [0.4, -0.1, 0.7], rpy: [0.3, -0.5, 1.2]} | [1, 2, 3] | [-0.8370849177621283, -0.4557234146508664, 4.213272229491274]\n\
             {xyz: [1, 2, 3], rpy: [0, 0, deg(90)]} | [1, 0, 0] | [1, 3, 3]\n\
             null | [1, 0, 0] | null",
        )],
        inputs: &[
            Port::typed("pose", Type::Pose, "pose of B in A"),
            Port::new(
                "point",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "point in B",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Is(Unit::METRE),
            "the same point in A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TransformPoint>()],
);

operands! {
    struct TransformPoint { pose: Slot<Pose>, point: Slot<Vector3>, out: Slot<Vector3> }
}

impl Step for TransformPoint {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let both = frame.known_pose(self.pose).zip(frame.composite(self.point));
        let seen = both.map(|(pose, point)| {
            vector::add(rotation::rotate(pose.orientation, point), pose.position)
        });
        frame.put_composite(self.out, seen)
    }
}
