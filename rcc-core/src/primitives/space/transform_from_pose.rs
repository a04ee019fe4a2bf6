//! `TransformFromPose`: a pose as a homogeneous transform.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule, operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "TransformFromPose",
        summary: "The homogeneous transform of a pose.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized",
        formula: "[R p; 0 1]",
        examples: &[Example::new(
            "rotation and translation",
            "",
            "in | out\n\
             {xyz: [1, 2, 3], rpy: [0, 0, deg(90)]} | [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]\n\
             null | null",
        )],
        inputs: &[Port::typed("in", Type::Pose, "pose of B in A")],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::TRANSFORM),
            UnitRule::Is(Unit::METRE),
            "transform of B in A, row-major; its last column is the position",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TransformFromPose>()],
);

operands! {
    struct TransformFromPose { input: Slot<Pose>, out: Slot<[Real; 16]> }
}

impl Step for TransformFromPose {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let transform = frame.known_pose(self.input).map(|pose| {
            let [[a, b, c], [d, e, f], [g, h, i]] = rotation::to_matrix(pose.orientation);
            let [x, y, z] = pose.position;
            [a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0]
        });
        frame.put_composite(self.out, transform)
    }
}
