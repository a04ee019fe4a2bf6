//! `Dot`: the sum of the products of the elements of two vectors, in order.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, TypeFamily, UnitRule, each};
use crate::types::{NULL_REAL, Store};

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
    &[Kernel::of(Store::Real, |frame, operands| {
        each(frame, operands, step);
    })],
);

fn step(frame: &mut Frame<'_>, [a, b, out, width]: [u32; 4]) -> Option<()> {
    let mut sum = 0.0;
    for i in 0..width {
        sum += frame.get_real(a + i)? * frame.get_real(b + i)?;
    }
    frame.put_real(out, if sum.is_finite() { sum } else { NULL_REAL })
}
