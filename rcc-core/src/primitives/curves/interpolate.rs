//! `Interpolate`: a rotation or pose between two others, by the shorter rotation about one axis.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, TypeFamily, UnitRule, operands,
};
use crate::types::Type;
use crate::unit::Unit;
use crate::{rotation, vector};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Interpolate",
        summary: "Interpolates between two rotations or poses: the position along a straight line, the orientation about one axis.",
        undefined: "rotations 180° apart, where both ways are equally short; overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "p + t (p_to - p) and exp(t log(R_to Rᵀ)) R (Slerp: Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985)",
        examples: &[
            Example::new(
                "interpolated by a quarter between rotations (scipy 1.17)",
                "",
                "from | to | t | out\n\
                 {quat: [0.18485641079320972, -0.323498718888117, 0.5083551296813268, 0.7763708832723447]} | {rpy: [0.3, -0.5, 1.2]} | 0.25 | {quat: [0.2040813503540178, -0.2738042666146767, 0.5266950958135888, 0.7784435124446696]}\n\
                 {rpy: [0, 0, 0]} | {quat: [1, 0, 0, 0]} | 0.25 | null\n\
                 null | {rpy: [0, 0, 0]} | 0.25 | null",
            ),
            Example::new(
                "halfway between poses, and extrapolated",
                "",
                "from | to | t | out\n\
                 {xyz: [0, 0, 0], rpy: [0, 0, 0]} | {xyz: [1, 2, 4], rpy: [0, 0, 1]} | 0.5 | {xyz: [0.5, 1, 2], rpy: [0, 0, 0.5]}\n\
                 {xyz: [0, 0, 0], rpy: [0, 0, 0]} | {xyz: [1, 2, 4], rpy: [0, 0, 1]} | 2 | {xyz: [2, 4, 8], rpy: [0, 0, 2]}\n\
                 {xyz: [0, 0, 0], rpy: [0, 0, 0]} | {xyz: [1, 2, 4], rpy: [0, 0, 1]} | null | null",
            ),
        ],
        inputs: &[
            Port::of("from", TypeFamily::Turn, UnitRule::Var(0), "value at t = 0"),
            Port::of("to", TypeFamily::Turn, UnitRule::Var(0), "value at t = 1"),
            Port::real(
                "t",
                UnitRule::Is(Unit::ONE),
                "interpolation parameter; below 0 and above 1 extrapolates",
            ),
        ],
        outputs: &[Port::of(
            "out",
            TypeFamily::Turn,
            UnitRule::Var(0),
            "value at t",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Interpolate>()],
);

const ROTATION: u32 = Type::Rotation.width();
const POSE: u32 = Type::Pose.width();

operands! {
    struct Interpolate for Real { from: Slot<Real>, to: Slot<Real>, t: Slot<Real>, out: Slot<Real>, width: u32 }
}

impl Step for Interpolate {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let t = frame.get(self.t)?;
        match self.width {
            ROTATION => {
                let ends = frame
                    .rotation(self.from.cast())
                    .zip(frame.rotation(self.to.cast()));
                let between = ends.and_then(|(from, to)| rotation::slerp(from, to, t));
                frame.put_composite(self.out.cast(), between)
            }
            POSE => {
                let ends = frame
                    .known_pose(self.from.cast())
                    .zip(frame.known_pose(self.to.cast()));
                let between = ends.and_then(|(from, to)| {
                    let translation = vector::subtract(to.position, from.position);
                    Some(Pose {
                        position: vector::add(from.position, vector::scale(translation, t)),
                        orientation: rotation::slerp(from.orientation, to.orientation, t)?,
                    })
                });
                frame.put_pose(self.out.cast(), between)
            }
            _ => None,
        }
    }
}
