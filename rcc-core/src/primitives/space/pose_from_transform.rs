//! `PoseFromTransform`: a homogeneous transform as a pose.

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
        name: "PoseFromTransform",
        summary: "The pose of a homogeneous transform.",
        undefined: "a rotation part that is not a rotation, as for RotationFromMatrix; overflow: an infinite input",
        formula: "the rotation nearest to the upper left 3 × 3 elements (see RotationFromMatrix), the position from the last column",
        examples: &[Example::new(
            "rotation and translation",
            "",
            "in | out\n\
             [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]] | {xyz: [1, 2, 3], rpy: [0, 0, deg(90)]}\n\
             [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]] | null\n\
             null | null",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Is(Type::TRANSFORM),
            UnitRule::Is(Unit::METRE),
            "transform of B in A, row-major; its last row is 0 0 0 1 and ignored",
        )],
        outputs: &[Port::typed("out", Type::Pose, "pose of B in A, w ≥ 0")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<PoseFromTransform>()],
);

operands! {
    struct PoseFromTransform { input: Slot<[Real; 16]>, out: Slot<Pose> }
}

impl Step for PoseFromTransform {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let transform = frame.composite::<16>(self.input);
        let pose = transform.and_then(|[a, b, c, x, d, e, f, y, g, h, i, z, ..]| {
            let orientation = rotation::from_matrix(&[[a, b, c], [d, e, f], [g, h, i]])?;
            Some(Pose {
                position: [x, y, z],
                orientation,
            })
        });
        frame.put_pose(self.out, pose)
    }
}
