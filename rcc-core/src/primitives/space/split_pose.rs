//! `SplitPose`: position and rotation of a pose.

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
        name: "SplitPose",
        summary: "The position and the rotation of a pose.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized",
        examples: &[Example::new(
            "known, and null",
            "",
            "in | position | rotation\n\
             {xyz: [1, -2, 3.5], rpy: [0.3, -0.5, 1.2]} | [1, -2, 3.5] | {rpy: [0.3, -0.5, 1.2]}\n\
             null | null | null",
        )],
        inputs: &[Port::typed("in", Type::Pose, "pose of B in A")],
        outputs: &[
            Port::new(
                "position",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "origin of B in A",
            ),
            Port::typed("rotation", Type::Rotation, "rotation of B in A"),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<SplitPose>()],
);

operands! {
    struct SplitPose { input: Slot<Pose>, position: Slot<Vector3>, rotation: Slot<Rotation> }
}

impl Step for SplitPose {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let pose = frame.known_pose(self.input);
        frame.put_composite(self.position, pose.map(|pose| pose.position))?;
        frame.put_composite(self.rotation, pose.map(|pose| pose.orientation))
    }
}
