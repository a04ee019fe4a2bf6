//! `Copy`: out = in. The loader inserts it where values must be contiguous, for a list of links.

use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, copy, each,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Copy",
        summary: "Passes its input through, of any type: a list of links becomes one named value.",
        null: "null is passed through, element by element",
        inputs: &[Port::new(
            "in",
            PortType::Any,
            UnitRule::Var(0),
            "any value",
        )],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "the same",
        )],
        examples: &[Example::new(
            "any type",
            "",
            "in | out\n [true, false] | [true, false]",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::single(Store::Real, |frame, operands| {
            each(frame, operands, |frame, [from, to]| {
                let value = frame.get_real(from)?;
                frame.put_real(to, value)
            });
        }),
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, |frame, [from, to, width]| {
                copy(frame, Store::Real, from, to, width)
            });
        }),
        Kernel::single(Store::Bool, |frame, operands| {
            each(frame, operands, |frame, [from, to]| {
                let value = frame.get_bool(from)?;
                frame.put_bool(to, value)
            });
        }),
        Kernel::of(Store::Bool, |frame, operands| {
            each(frame, operands, |frame, [from, to, width]| {
                copy(frame, Store::Bool, from, to, width)
            });
        }),
        Kernel::single(Store::Int, |frame, operands| {
            each(frame, operands, |frame, [from, to]| {
                let value = frame.get_int(from)?;
                frame.put_int(to, value)
            });
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, |frame, [from, to, width]| {
                copy(frame, Store::Int, from, to, width)
            });
        }),
    ],
);
