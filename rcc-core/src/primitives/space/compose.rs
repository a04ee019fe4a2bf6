//! `Compose`: chains two frames: the pose of C in A from B in A and C in B, out = a · b.
//!
//! Each element of a product of transforms is ((a₀·b₀ + a₁·b₁) + a₂·b₂) + a₃·b₃, with every operation rounded once.

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
        name: "Compose",
        summary: "Chains two rotations, poses or transforms: the second is given in the frame of the first.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "R_a R_b and p_a + R_a p_b; quaternions are normalized; for transforms the matrix product",
        examples: &[
            Example::new(
                "rotations (scipy 1.17): b is about the axes rotated by a",
                "",
                "a | b | out\n\
                 {rpy: [0.3, -0.5, 1.2]} | {quat: [0.18485641079320972, -0.323498718888117, 0.5083551296813268, 0.7763708832723447]} | {quat: [0.46611343908948644, -0.3676405431603912, 0.7738747034672753, 0.22067314349132097]}\n\
                 {rpy: [0.3, -0.5, 1.2]} | null | null",
            ),
            Example::new(
                "poses: 90° about z, then 1 m along its x, which is the outer y",
                "",
                "a | b | out\n\
                 {xyz: [1, 2, 3], rpy: [0, 0, deg(90)]} | {xyz: [1, 0, 0], rpy: [0, 0, 0]} | {xyz: [1, 3, 3], rpy: [0, 0, deg(90)]}\n\
                 null | {xyz: [1, 0, 0], rpy: [0, 0, 0]} | null",
            ),
            Example::new(
                "transforms",
                "",
                "a | b | out\n\
                 [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]] | [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]] | [[-1, 0, 0, -1], [0, -1, 0, 3], [0, 0, 1, 6], [0, 0, 0, 1]]\n\
                 null | [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]] | null",
            ),
        ],
        inputs: &[
            Port::of(
                "a",
                TypeFamily::Frame,
                UnitRule::Var(0),
                "frame B in frame A",
            ),
            Port::of(
                "b",
                TypeFamily::Frame,
                UnitRule::Var(0),
                "frame C in frame B",
            ),
        ],
        outputs: &[Port::of(
            "out",
            TypeFamily::Frame,
            UnitRule::Var(0),
            "frame C in frame A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Compose>()],
);

const ROTATION: u32 = Type::Rotation.width();
const POSE: u32 = Type::Pose.width();
type Transform = [Real; 16];
const TRANSFORM: u32 = Type::TRANSFORM.width();

operands! {
    struct Compose for Real { a: Slot<Real>, b: Slot<Real>, out: Slot<Real>, width: u32 }
}

impl Step for Compose {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        match self.width {
            TRANSFORM => transforms(frame, self.a.cast(), self.b.cast(), self.out.cast()),
            POSE => {
                let a: Pose = frame.get(self.a.cast())?;
                let b: Pose = frame.get(self.b.cast())?;
                frame.put(self.out.cast(), a.compose(&b))
            }
            ROTATION => {
                let both = frame
                    .rotation(self.a.cast())
                    .zip(frame.rotation(self.b.cast()));
                frame.put_composite(self.out.cast(), both.map(|(a, b)| rotation::product(a, b)))
            }
            _ => None,
        }
    }
}

#[inline(always)]
fn transforms(
    frame: &mut Frame<'_>,
    a: Slot<Transform>,
    b: Slot<Transform>,
    out: Slot<Transform>,
) -> Option<()> {
    let [a, b] = [frame.get(a)?, frame.get(b)?];
    let ([.., last_a], [.., last_b]) = (a, b);
    let [a0, a1, a2, a3]: [[f64; 4]; 4] = bytemuck::cast(a);
    let b: [[f64; 4]; 4] = bytemuck::cast(b);
    let product = if last_a.is_nan() | last_b.is_nan() {
        [[NULL_REAL; 4]; 4]
    } else {
        [row(a0, &b), row(a1, &b), row(a2, &b), row(a3, &b)]
    };
    frame.put(out, bytemuck::cast(product))
}

/// Returns one row of the product.
#[inline(always)]
fn row([a0, a1, a2, a3]: [f64; 4], b: &[[f64; 4]; 4]) -> [f64; 4] {
    let [
        [b00, b01, b02, b03],
        [b10, b11, b12, b13],
        [b20, b21, b22, b23],
        [b30, b31, b32, b33],
    ] = *b;
    [
        a0 * b00 + a1 * b10 + a2 * b20 + a3 * b30,
        a0 * b01 + a1 * b11 + a2 * b21 + a3 * b31,
        a0 * b02 + a1 * b12 + a2 * b22 + a3 * b32,
        a0 * b03 + a1 * b13 + a2 * b23 + a3 * b33,
    ]
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::Store;

    #[test]
    fn null_in_one_element_makes_every_element_null() {
        for width in [4, 7, 16] {
            for (name, other) in [("a", "b"), ("b", "a")] {
                let mut bench = PrimitiveHarness::wide("Compose", Some(Store::Real), width as u32);
                let mut known = std::vec![0.0; width];
                known[width - 1] = 1.0;
                let mut null = known.clone();
                null[width - 1] = f64::NAN;
                bench.set_reals(name, &known).set_reals(other, &null);
                let out = bench.step().reals("out", width);
                assert!(out.iter().all(|value| value.is_nan()), "{width} {other}");
            }
        }
    }
}
