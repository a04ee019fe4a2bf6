//! `TwistFromPoses`: the twist between two successive poses.

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
        name: "TwistFromPoses",
summary: "The constant twist that leads from the previous pose to this one in one period of the net.",
undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
formula: "v = (p - p_previous) / T, ω = log(R R_previousᵀ) / T with the period T; at 180° per period, one of the two possible rotations is returned",
examples: &[Example::new("one period of 10 ms", "", "pose | previous | out\n\
             {xyz: [0.401, -0.098, 0.697], rpy: [0, 0, 0.31]} | {xyz: [0.4, -0.1, 0.7], rpy: [0, 0, 0.3]} | [0.1, 0.2, -0.3, 0, 0, 1]\n\
             {xyz: [0, 0, 0], rpy: [0, 0, 0]} | null | null").every_ms(10),],
inputs: &[Port::typed("pose", Type::Pose, "pose of B in A"), Port::typed("previous", Type::Pose, "pose one period before, via a delayed link")],
outputs: &[Port::typed("out", Type::Twist, "in axes of A, reference point the origin of B")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<TwistFromPoses>()],
);

operands! {
    struct TwistFromPoses { pose: Slot<Pose>, previous: Slot<Pose>, out: Slot<Spatial> }
}

impl Step for TwistFromPoses {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let period = frame.dt_s;
        let both = frame
            .known_pose(self.previous)
            .zip(frame.known_pose(self.pose));
        let twist = both.map(|(previous, pose)| spatial::difference(&previous, &pose, period));
        frame.put_composite(self.out, twist)
    }
}
