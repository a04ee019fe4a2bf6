//! `TwistTransform`: a twist, expressed in another frame.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Slot, Spatial, Spec, Step, operands,
};
use crate::spatial;
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "TwistTransform",
        summary: "A twist of an inner frame, expressed in the outer frame: axes and reference point both change.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "ω_A = R ω_B, v_A = R v_B + p × ω_A (the adjoint: Lynch and Park, Modern Robotics, 2017, section 3.3.2)",
        examples: &[Example::new(
            "rotation and translation (numpy, scipy 1.17)",
            "",
            "pose | in | out\n\
             {xyz: [0.4, -0.1, 0.7], rpy: [0.3, -0.5, 1.2]} | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6] | [-0.2553502566625213, 0.45017431028622407, -0.09039058934012492, 0.6013824871510615, 0.0029398128804087216, 0.6390074034377311]\n\
             {xyz: [0, 0, 0], rpy: [0, 0, 0]} | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6] | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6]\n\
             null | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6] | null",
        )],
        inputs: &[
            Port::typed("pose", Type::Pose, "pose of B in A"),
            Port::typed(
                "in",
                Type::Twist,
                "twist in axes of B, reference point its origin",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Twist,
            "the same motion in axes of A, reference point the origin of A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TwistTransform>()],
);

operands! {
    struct TwistTransform { pose: Slot<Pose>, input: Slot<Spatial>, out: Slot<Spatial> }
}

impl Step for TwistTransform {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let both = frame.known_pose(self.pose).zip(frame.composite(self.input));
        frame.put_composite(
            self.out,
            both.map(|(pose, twist)| spatial::transform_twist(&pose, twist)),
        )
    }
}
