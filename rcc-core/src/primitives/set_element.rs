//! `SetElement`: an array with one element replaced, by a computed index.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Spec, UnitRule, copy, each,
    fill_null,
};
use crate::types::Store;

const ARRAY: PortType = PortType::Array(ElementType::Open, Dim::Var(0));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SetElement",
        summary: "An array with the element at an index replaced.",
        null: "null elements are passed through, a null value is stored; a null index gives null in every element",
        undefined: "index < 0 or index ≥ the length",
        inputs: &[
            Port::new("in", ARRAY, UnitRule::Var(0), "the array"),
            Port::int("index", "index of the element, from 0"),
            Port::new("value", PortType::Scalar, UnitRule::Var(0), "its new value"),
        ],
        outputs: &[Port::new("out", ARRAY, UnitRule::Var(0), "the new array")],
        examples: &[Example::new(
            "an index inside and outside",
            "",
            "in | index | value | out
             [4.0, 5.5, 6.0] | 1 | 7.0 | [4.0, 7.0, 6.0]
             [4.0, 5.5, 6.0] | 3 | 7.0 | null",
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
fn step(
    frame: &mut Frame<'_>,
    store: Store,
    [input, index, value, out, length]: [u32; 5],
) -> Option<()> {
    match u32::try_from(frame.get_int(index)?) {
        Ok(index) if index < length => {
            copy(frame, store, input, out, length)?;
            copy(frame, store, value, out + index, 1)
        }
        _ => fill_null(frame, store, out, length),
    }
}
