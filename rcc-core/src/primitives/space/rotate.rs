//! `Rotate`: transforms a vector, twist or wrench from axes of an inner frame to axes of the outer frame.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Kernel, Port, Real, Rotation, Slot, Spec, Step, TypeFamily, UnitRule, operands,
};
use crate::types::Type;
use crate::{rotation, spatial};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Rotate",
        summary: "Transforms a vector, twist or wrench from axes of an inner frame to axes of the outer frame; reference points stay.",
        undefined: "overflow: an infinite input, a quaternion that cannot be normalized, a result out of range",
        formula: "R in, for twists and wrenches applied to both vectors; q [in, 0] q⁻¹ as in + 2w (u × in) + 2u × (u × in)",
        inputs: &[
            Port::typed("rotation", Type::Rotation, "rotation of B in A"),
            Port::of("in", TypeFamily::Axes, UnitRule::Var(0), "in axes of B"),
        ],
        outputs: &[Port::of(
            "out",
            TypeFamily::Axes,
            UnitRule::Var(0),
            "the same in axes of A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Rotate>()],
);

const ONE_VECTOR: u32 = Type::Vector3.width();
const TWO_VECTORS: u32 = Type::Twist.width();

operands! {
    struct Rotate for Real { rotation: Slot<Rotation>, input: Slot<Real>, out: Slot<Real>, width: u32 }
}

impl Step for Rotate {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let turn = frame.rotation(self.rotation);
        match self.width {
            ONE_VECTOR => {
                let both = turn.zip(frame.composite(self.input.cast()));
                frame.put_composite(
                    self.out.cast(),
                    both.map(|(turn, vector)| rotation::rotate(turn, vector)),
                )
            }
            TWO_VECTORS => {
                let both = turn.zip(frame.composite(self.input.cast()));
                let turned = both.map(|(turn, six)| {
                    let (a, b) = spatial::split(six);
                    spatial::join(rotation::rotate(turn, a), rotation::rotate(turn, b))
                });
                frame.put_composite(self.out.cast(), turned)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::Store;

    /// Roll 0.3, pitch -0.5, yaw 1.2 rad, and the image of [1, 2, 3] (scipy 1.17).
    const TURN: [f64; 4] = [
        0.25762853798958335,
        -0.12014247631977643,
        0.5714598517275828,
        0.7698226806613264,
    ];
    const TURNED: [f64; 3] = [-1.2370849177621284, -0.35572341465086643, 3.513272229491274];

    #[test]
    fn one_vector_or_both_are_rotated() {
        let mut bench = PrimitiveHarness::wide("Rotate", Some(Store::Real), 3);
        bench
            .set_reals("rotation", &TURN)
            .set_reals("in", &[1.0, 2.0, 3.0]);
        for (got, want) in bench.step().reals("out", 3).iter().zip(TURNED) {
            assert!((got - want).abs() < 1e-14, "{got} {want}");
        }
        let mut bench = PrimitiveHarness::wide("Rotate", Some(Store::Real), 6);
        bench
            .set_reals("rotation", &TURN)
            .set_reals("in", &[1.0, 2.0, 3.0, -1.0, -2.0, -3.0]);
        let both = TURNED.into_iter().chain(TURNED.map(|x| -x));
        for (got, want) in bench.step().reals("out", 6).iter().zip(both) {
            assert!((got - want).abs() < 1e-14, "{got} {want}");
        }
    }

    #[test]
    fn null_makes_every_element_null() {
        let mut bench = PrimitiveHarness::wide("Rotate", Some(Store::Real), 6);
        bench
            .set_reals("rotation", &TURN)
            .set_reals("in", &[1.0, 2.0, 3.0, -1.0, -2.0, f64::NAN]);
        assert!(
            bench
                .step()
                .reals("out", 6)
                .iter()
                .all(|value| value.is_nan())
        );
        bench
            .set_reals("in", &[1.0; 6])
            .set_reals("rotation", &[0.0; 4]);
        assert!(
            bench
                .step()
                .reals("out", 6)
                .iter()
                .all(|value| value.is_nan())
        );
    }
}
