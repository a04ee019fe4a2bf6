//! `Dot`: the sum of the products of the elements of two vectors, in order.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, TypeFamily, UnitRule, operands,
};
use crate::types::NULL_REAL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Dot",
        summary: "The dot product of two vectors or arrays of the same length.",
        null: "a null element gives null",
        undefined: "overflow: an infinite element, a result out of range",
        formula: "((a₀ b₀ + a₁ b₁) + a₂ b₂) + …, with every operation rounded once",
        examples: &[Example::new(
            "a product, and null",
            "",
            "a | b | out\n\
             [1.0, 2.0, 3.0] | [-2.0, 1.0, 0.5] | 1.5\n\
             [1.0, 0.0, 0.0] | [0.0, 1.0, 0.0] | 0.0\n\
             [1.0, 0.0, 0.0] | null | null",
        )],
        inputs: &[
            Port::of("a", TypeFamily::Vector, UnitRule::Var(0), "first factor"),
            Port::of(
                "b",
                TypeFamily::Vector,
                UnitRule::Var(1),
                "second factor, same axes",
            ),
        ],
        outputs: &[Port::real("out", UnitRule::Product(0, 1), "a · b")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Dot>()],
);

operands! {
    struct Dot for Real { a: Slot<Real>, b: Slot<Real>, out: Slot<Real>, width: u32 }
}

impl Step for Dot {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let mut sum = 0.0;
        for i in 0..self.width {
            sum += frame.get(self.a + i)? * frame.get(self.b + i)?;
        }
        frame.put(self.out, if sum.is_finite() { sum } else { NULL_REAL })
    }
}
