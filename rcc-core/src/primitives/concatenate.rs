//! `Concatenate`: joins two arrays. Single values are joined by a list of links: `[a.out, b.out]`.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Spec, UnitRule, copy, each,
};
use crate::types::Store;

const fn array(length: Dim) -> PortType {
    PortType::Array(ElementType::Open, length)
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Concatenate",
        summary: "Joins two arrays, the second after the first.",
        null: "null is passed through, element by element",
        inputs: &[
            Port::new(
                "a",
                array(Dim::Var(0)),
                UnitRule::Var(0),
                "the first elements",
            ),
            Port::new(
                "b",
                array(Dim::Var(1)),
                UnitRule::Var(0),
                "the last elements",
            ),
        ],
        outputs: &[Port::new(
            "out",
            array(Dim::Sum(0, 1)),
            UnitRule::Var(0),
            "all elements",
        )],
        examples: &[Example::new(
            "arrays of different lengths",
            "",
            "a | b | out\n [1.0, 2.0] | [3.0, 4.0, 5.0] | [1.0, 2.0, 3.0, 4.0, 5.0]",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, |frame, group| {
                step(frame, Store::Real, group)
            });
        }),
        Kernel::of(Store::Bool, |frame, operands| {
            each(frame, operands, |frame, group| {
                step(frame, Store::Bool, group)
            });
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, |frame, group| {
                step(frame, Store::Int, group)
            });
        }),
    ],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, store: Store, [a, b, out, first, second]: [u32; 5]) -> Option<()> {
    copy(frame, store, a, out, first)?;
    copy(frame, store, b, out + first, second)
}
