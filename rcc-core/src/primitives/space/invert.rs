//! `Invert`: the outer frame expressed in the inner one.
//!
//! For a rigid transform the rotation is transposed and the position becomes -((r₀ᵢ·x + r₁ᵢ·y) + r₂ᵢ·z), with every
//! operation rounded once.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, TypeFamily, UnitRule, operands,
};
use crate::rotation;
use crate::types::{NULL_REAL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Invert",
        summary: "The inverse of a rotation, pose or transform.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "Rᵀ and -Rᵀ p",
        examples: &[
            Example::new(
                "a rotation",
                "",
                "in | out\n {rpy: [0, 0, 0.5]} | {rpy: [0, 0, -0.5]}\n null | null",
            ),
            Example::new(
                "a pose",
                "",
                "in | out\n\
                 {xyz: [1, 2, 3], rpy: [0, 0, deg(90)]} | {xyz: [-2, 1, -3], rpy: [0, 0, deg(-90)]}\n\
                 null | null",
            ),
            Example::new(
                "a transform",
                "",
                "in | out\n\
                 [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]] | [[0, 1, 0, -2], [-1, 0, 0, 1], [0, 0, 1, -3], [0, 0, 0, 1]]\n\
                 null | null",
            ),
        ],
        inputs: &[Port::of(
            "in",
            TypeFamily::Frame,
            UnitRule::Var(0),
            "frame B in frame A",
        )],
        outputs: &[Port::of(
            "out",
            TypeFamily::Frame,
            UnitRule::Var(0),
            "frame A in frame B",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Invert>()],
);

const ROTATION: u32 = Type::Rotation.width();
const POSE: u32 = Type::Pose.width();
type Transform = [Real; 16];
const TRANSFORM: u32 = Type::TRANSFORM.width();

operands! {
    struct Invert for Real { input: Slot<Real>, out: Slot<Real>, width: u32 }
}

impl Step for Invert {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        match self.width {
            TRANSFORM => transform(frame, self.input.cast(), self.out.cast()),
            POSE => {
                let pose: Pose = frame.get(self.input.cast())?;
                frame.put(self.out.cast(), pose.inverse())
            }
            ROTATION => {
                let back = frame.rotation(self.input.cast()).map(rotation::inverse);
                frame.put_composite(self.out.cast(), back)
            }
            _ => None,
        }
    }
}

#[inline(always)]
fn transform(frame: &mut Frame<'_>, input: Slot<Transform>, out: Slot<Transform>) -> Option<()> {
    let [a, b, c, x, d, e, f, y, g, h, i, z, _, _, _, last] = frame.get(input)?;
    let back = |p: f64, q: f64, r: f64| -(p * x + q * y + r * z);
    let inverse = [
        [a, d, g, back(a, d, g)],
        [b, e, h, back(b, e, h)],
        [c, f, i, back(c, f, i)],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let null = last.is_nan();
    frame.put(
        out,
        if null {
            [NULL_REAL; 16]
        } else {
            bytemuck::cast(inverse)
        },
    )
}

#[cfg(test)]
mod tests {
    use crate::pose::Pose;
    use crate::testing::PrimitiveHarness;
    use crate::types::Store;

    #[test]
    fn a_pose_and_its_inverse_cancel() {
        let pose = Pose::from_xyz_rpy([0.4, -0.1, 0.7], [0.3, -1.1, 2.2]);
        let mut bench = PrimitiveHarness::wide("Invert", Some(Store::Real), 7);
        let out = bench.set_reals("in", &pose.to_slots()).step();
        let inverse = Pose::from_slots(out.reals("out", 7).try_into().unwrap());
        let both = pose.compose(&inverse).to_slots();
        for (got, want) in both.iter().zip([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) {
            assert!((got.abs() - want).abs() < 1e-15, "{both:?}");
        }
    }
}
