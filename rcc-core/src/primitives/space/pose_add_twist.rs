//! `PoseAddTwist`: a pose advanced by a twist over one cycle.

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
        name: "PoseAddTwist",
summary: "The pose after moving for one period of the net with a constant twist.",
undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
formula: "p + v T, exp(ω T) R with the period T: exact for a constant twist, inverse of TwistFromPoses",
examples: &[Example::new("one period of 10 ms (scipy 1.17)", "", "pose | twist | out\n\
             {xyz: [0.4, -0.1, 0.7], rpy: [0.3, -0.5, 1.2]} | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6] | {xyz: [0.401, -0.098, 0.697], quat: [0.25876811908192066, -0.1223367222833714, 0.573978712263488, 0.7672165436147178]}\n\
             {xyz: [0, 0, 0], rpy: [0, 0, 0]} | null | null").every_ms(10),],
inputs: &[Port::typed("pose", Type::Pose, "pose of B in A"), Port::typed("twist", Type::Twist, "in axes of A, reference point the origin of B")],
outputs: &[Port::typed("out", Type::Pose, "pose of B in A one period later")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<PoseAddTwist>()],
);

operands! {
    struct PoseAddTwist { pose: Slot<Pose>, twist: Slot<Spatial>, out: Slot<Pose> }
}

impl Step for PoseAddTwist {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let period = frame.dt_s;
        let both = frame.known_pose(self.pose).zip(frame.composite(self.twist));
        let next = both.map(|(pose, twist)| spatial::integrate(&pose, twist, period));
        frame.put_pose(self.out, next)
    }
}
