//! `PoseError`: the difference between an actual and a desired pose.

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
    &[Kernel::each::<PoseError>()],
);

operands! {
    struct PoseError { from: Slot<Pose>, to: Slot<Pose>, translation: Slot<Vector3>, rotation: Slot<Vector3> }
}

impl Step for PoseError {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let poses = frame.known_pose(self.from).zip(frame.known_pose(self.to));
        let difference = poses.map(|(from, to)| vector::subtract(to.position, from.position));
        let angle = poses.map(|(from, to)| rotation::error(from.orientation, to.orientation));
        frame.put_composite(self.translation, difference)?;
        frame.put_composite(self.rotation, angle)
    }
}
