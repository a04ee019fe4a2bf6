//! `WrenchTransform`: a wrench, expressed in another frame.

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
        name: "WrenchTransform",
        summary: "A wrench of an inner frame, expressed in the outer frame: axes and reference point both change.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "f_A = R f_B, t_A = R t_B + p × f_A (Lynch and Park, Modern Robotics, 2017, section 3.4)",
        examples: &[Example::new(
            "rotation and translation (numpy, scipy 1.17)",
            "",
            "pose | in | out\n\
             {xyz: [0.4, -0.1, 0.7], rpy: [0.3, -0.5, 1.2]} | [10, -5, 2, 0.3, 0.1, -0.2] | [8.107681171418623, 6.040861171946876, 5.174311772969283, -4.766703705981206, 3.979240677687767, 3.229197256788256]\n\
             {xyz: [0, 0, 0], rpy: [0, 0, 0]} | [10, -5, 2, 0.3, 0.1, -0.2] | [10, -5, 2, 0.3, 0.1, -0.2]\n\
             null | [10, -5, 2, 0.3, 0.1, -0.2] | null",
        )],
        inputs: &[
            Port::typed("pose", Type::Pose, "pose of B in A"),
            Port::typed(
                "in",
                Type::Wrench,
                "wrench in axes of B, reference point its origin",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Wrench,
            "the same load in axes of A, reference point the origin of A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<WrenchTransform>()],
);

operands! {
    struct WrenchTransform { pose: Slot<Pose>, input: Slot<Spatial>, out: Slot<Spatial> }
}

impl Step for WrenchTransform {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let both = frame.known_pose(self.pose).zip(frame.composite(self.input));
        frame.put_composite(
            self.out,
            both.map(|(pose, wrench)| spatial::transform_wrench(&pose, wrench)),
        )
    }
}
