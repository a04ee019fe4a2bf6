//! `TransformInvert`: the inverse of a homogeneous transform that turns and moves, and does not scale.
//!
//! The rotation is transposed; the position becomes -((r₀ᵢ·x + r₁ᵢ·y) + r₂ᵢ·z), every operation rounded once.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::types::{NULL_REAL, Type};

const TRANSFORM: PortType = PortType::Is(Type::TRANSFORM);

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "TransformInvert",
        summary: "The inverse of a transform.",
        inputs: &[Port::new(
            "in",
            TRANSFORM,
            UnitRule::Var(0),
            "transform of frame B in frame A",
        )],
        outputs: &[Port::new(
            "out",
            TRANSFORM,
            UnitRule::Var(0),
            "transform of frame A in frame B",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out]: [u32; 2]) -> Option<()> {
    let [a, b, c, x, d, e, f, y, g, h, i, z, _, _, _, last] = frame.get_reals(input)?;
    let back = |p: f64, q: f64, r: f64| -(p * x + q * y + r * z);
    let inverse = [
        [a, d, g, back(a, d, g)],
        [b, e, h, back(b, e, h)],
        [c, f, i, back(c, f, i)],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let null = last.is_nan();
    frame.put_reals(
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
    use crate::testing::Bench;

    #[test]
    fn turns_and_moves_back() {
        // 90° about z at (1, 2, 3): the outer origin is at (-2, 1, -3) in the turned frame.
        let turned = [
            0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0,
        ];
        let want = [
            0.0, 1.0, 0.0, -2.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -3.0, 0.0, 0.0, 0.0, 1.0,
        ];
        let mut bench = Bench::new("TransformInvert");
        let out = bench.set_reals("in", &turned).step().reals("out", 16);
        assert_eq!(out, want);
    }

    #[test]
    fn null_makes_every_element_null() {
        let mut bench = Bench::new("TransformInvert");
        let out = bench.step().reals("out", 16);
        assert!(out.iter().all(|value| value.is_nan()));
    }
}
