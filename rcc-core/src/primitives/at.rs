//! `At`: an element of an array, by a computed index. A fixed element is written as a link: `a.out[2]`.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Spec, UnitRule, copy, each,
    fill_null,
};
use crate::types::Store;

const LENGTH: Dim = Dim::Var(0);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "At",
        summary: "The element of an array at an index.",
        undefined: "index < 0 or index ≥ the length",
        inputs: &[
            Port::new(
                "in",
                PortType::Array(ElementType::Open, LENGTH),
                UnitRule::Var(0),
                "the array",
            ),
            Port::int("index", "index of the element, from 0"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Scalar,
            UnitRule::Var(0),
            "the element",
        )],
        examples: &[Example::new(
            "an index inside and outside",
            "",
            "in | index | out
             [4.0, 5.5, 6.0] | 1 | 5.5
             [4.0, 5.5, 6.0] | 3 | null
             [4.0, 5.5, 6.0] | -1 | null
             [4.0, 5.5, 6.0] | null | null",
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
fn step(frame: &mut Frame<'_>, store: Store, [input, index, out, length]: [u32; 4]) -> Option<()> {
    // A null index is negative.
    match u32::try_from(frame.get_int(index)?) {
        Ok(index) if index < length => copy(frame, store, input + index, out, 1),
        _ => fill_null(frame, store, out, 1),
    }
}
