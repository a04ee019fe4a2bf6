//! `MakePose`: a pose from a position and a rotation.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Rotation, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MakePose",
        summary: "A pose from its position and its rotation.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized",
        examples: &[Example::new(
            "known, and null",
            "",
            "position | rotation | out\n\
             [1, -2, 3.5] | {rpy: [0.3, -0.5, 1.2]} | {xyz: [1, -2, 3.5], rpy: [0.3, -0.5, 1.2]}\n\
             [1, -2, 3.5] | null | null\n\
             null | {rpy: [0, 0, 0]} | null",
        )],
        inputs: &[
            Port::new(
                "position",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "origin of B in A",
            ),
            Port::typed("rotation", Type::Rotation, "rotation of B in A"),
        ],
        outputs: &[Port::typed("out", Type::Pose, "pose of B in A")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<MakePose>()],
);

operands! {
    struct MakePose { position: Slot<Vector3>, rotation: Slot<Rotation>, out: Slot<Pose> }
}

impl Step for MakePose {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let parts = frame
            .composite(self.position)
            .zip(frame.rotation(self.rotation));
        let pose = parts.map(|(position, orientation)| Pose {
            position,
            orientation,
        });
        frame.put_pose(self.out, pose)
    }
}
