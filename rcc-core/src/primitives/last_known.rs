//! `LastKnown`: the last value that was not null, of any type. For nets in which a slightly old value is better than
//! null; a device must never be commanded with it.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, MemorySpec, NullRule, Parameter, ParameterKind,
    Port, PortType, Spec, UnitRule, copy, each, is_null,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "LastKnown",
        summary: "Its input or, while that is null, the last value that was not null.",
        null: "a null input, or an array or vector with a null element, gives the value before it; null only before the first value if `initial` is null",
        null_rule: NullRule::Remembers,
        inputs: &[Port::new(
            "in",
            PortType::Any,
            UnitRule::Var(0),
            "a value that may be null",
        )],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "the last value that was not null",
        )],
        parameters: &[Parameter::new(
            "initial",
            ParameterKind::First(UnitRule::Var(0)),
            "output before the first value",
        )
        .default(DefaultValue::Null)],
        memory: MemorySpec::values(1),
        examples: &[
            Example::new(
                "with an initial value",
                "{initial: 9.0}",
                "in | out
                 null | 9.0
                 1.5 | 1.5
                 null | 1.5",
            ),
            Example::new(
                "without an initial value",
                "",
                "in | out
                 null | null
                 true | true
                 null | true",
            ),
        ],
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
fn step(frame: &mut Frame<'_>, store: Store, [input, out, memory, width]: [u32; 4]) -> Option<()> {
    if !is_null(frame, store, input, width)? {
        copy(frame, store, input, memory, width)?;
    }
    copy(frame, store, memory, out, width)
}
