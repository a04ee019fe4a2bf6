//! `MakePose`: a pose from a position and a rotation.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [position, rotation, out]: [u32; 3]) {
    let parts = frame.composite(position).zip(frame.rotation(rotation));
    let pose = parts.map(|(position, orientation)| Pose {
        position,
        orientation,
    });
    frame.set_known_pose(out, pose);
}
