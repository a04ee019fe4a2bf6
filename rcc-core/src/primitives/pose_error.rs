//! `PoseError`: the difference between an actual and a desired pose.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;
use crate::vector;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "PoseError",
        summary: "The translation and the rotation that lead from one pose to another, in the outer axes.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, positions too far apart for a number",
        formula: "[p_to - p_from, log(R_to R_fromᵀ)]; at 180° one of the two possible vectors is returned",
        examples: &[Example::new(
            "oblique (scipy 1.17)",
            "",
            "from | to | translation | rotation\n\
             {xyz: [1, 1, 1], quat: [0.18485641079320972, -0.323498718888117, 0.5083551296813268, 0.7763708832723447]} | {xyz: [1, 3, 0.5], rpy: [0.3, -0.5, 1.2]} | [0, 2, -0.5] | [-0.13329337432887994, 0.36527084124707254, 0.22884581650653762]\n\
             null | {xyz: [1, 3, 0.5], rpy: [0, 0, 0]} | null | null",
        )],
        inputs: &[
            Port::typed("from", Type::Pose, "actual pose, in A"),
            Port::typed("to", Type::Pose, "desired pose, in A"),
        ],
        outputs: &[
            Port::new(
                "translation",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "translation from origin to origin, axes of A",
            ),
            Port::new(
                "rotation",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::RADIAN),
                "rotation as axis × angle in axes of A, length at most π",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [from, to, translation, turn]: [u32; 4]) {
    let poses = frame.known_pose(from).zip(frame.known_pose(to));
    let difference = poses.map(|(from, to)| vector::subtract(to.position, from.position));
    let angle = poses.map(|(from, to)| rotation::error(from.orientation, to.orientation));
    frame.set_composite(translation, difference);
    frame.set_composite(turn, angle);
}
