//! `Multiplexer`: selects one of any number of values of the same type, by an index.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, Kernel, NullRule, Port, PortType, Spec, UnitRule, copy, each, fill_null,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Multiplexer",
        summary: "Selects one of a list of values of any type, by an index.",
        null: "a null index gives null; among the values, only the selected one matters",
        null_rule: NullRule::FirstAndAnyKnown,
        undefined: "index < 0 or index ≥ the number of values",
        inputs: &[
            Port::int("index", "index of the value, from 0"),
            Port::new(
                "in",
                PortType::Many(Dim::Var(0)),
                UnitRule::Var(0),
                "the values, as a list of links: `[a.pose, b.pose]`",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "selected value",
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
    [index, input, out, width, count]: [u32; 5],
) -> Option<()> {
    // A null index is negative.
    match u32::try_from(frame.get_int(index)?) {
        Ok(index) if index < count => copy(frame, store, input + index * width, out, width),
        _ => fill_null(frame, store, out, width),
    }
}
