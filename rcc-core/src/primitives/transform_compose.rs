//! `TransformCompose`: the product of two homogeneous transforms, out = a · b; what `PoseCompose` is to poses.
//!
//! Each element is ((a₀·b₀ + a₁·b₁) + a₂·b₂) + a₃·b₃, every operation rounded once.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::types::{NULL_REAL, Type};

const TRANSFORM: PortType = PortType::Is(Type::TRANSFORM);

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "TransformCompose",
        summary: "Chains two transforms: the second is given in the frame of the first.",
        inputs: &[
            Port::new(
                "a",
                TRANSFORM,
                UnitRule::Var(0),
                "transform of frame B in frame A",
            ),
            Port::new(
                "b",
                TRANSFORM,
                UnitRule::Var(0),
                "transform of frame C in frame B",
            ),
        ],
        outputs: &[Port::new(
            "out",
            TRANSFORM,
            UnitRule::Var(0),
            "transform of frame C in frame A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out]: [u32; 3]) -> Option<()> {
    let [a, b] = [frame.get_reals::<16>(a)?, frame.get_reals::<16>(b)?];
    let ([.., last_a], [.., last_b]) = (a, b);
    let [a0, a1, a2, a3]: [[f64; 4]; 4] = bytemuck::cast(a);
    let b: [[f64; 4]; 4] = bytemuck::cast(b);
    let product = if last_a.is_nan() | last_b.is_nan() {
        [[NULL_REAL; 4]; 4]
    } else {
        [row(a0, &b), row(a1, &b), row(a2, &b), row(a3, &b)]
    };
    frame.put_reals::<16>(out, bytemuck::cast(product))
}

/// A row of the product.
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
    use crate::testing::Bench;

    /// 90° about z at (1, 2, 3).
    const TURNED: [f64; 16] = [
        0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0,
    ];

    #[test]
    fn the_second_transform_is_turned_by_the_first() {
        let mut bench = Bench::new("TransformCompose");
        bench.set_reals("a", &TURNED).set_reals("b", &TURNED);
        let want = [
            -1.0, 0.0, 0.0, -1.0, 0.0, -1.0, 0.0, 3.0, 0.0, 0.0, 1.0, 6.0, 0.0, 0.0, 0.0, 1.0,
        ];
        assert_eq!(bench.step().reals("out", 16), want);
    }

    #[test]
    fn null_makes_every_element_null() {
        for (name, other) in [("a", "b"), ("b", "a")] {
            let mut bench = Bench::new("TransformCompose");
            let mut null = TURNED;
            null[15] = f64::NAN;
            bench.set_reals(name, &TURNED).set_reals(other, &null);
            let out = bench.step().reals("out", 16);
            assert!(out.iter().all(|value| value.is_nan()), "{other}");
        }
    }
}
