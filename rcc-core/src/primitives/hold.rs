//! `Hold`: sample and hold of any value.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, MemorySpec, NullRule, Parameter, ParameterKind,
    Port, PortType, Spec, UnitRule, copy, each, is_null,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Hold",
        summary: "The value of the last cycle in which `sample` was true.",
        null: "a null `in` is not sampled, and a null `sample` samples nothing; null until the first sample, unless `initial` is given",
        null_rule: NullRule::Known,
        undefined: "nothing sampled yet",
        examples: &[
            Example::new(
                "a number",
                "{initial: 1}",
                "in | sample | out
                 5 | false | 1
                 6 | true | 6
                 7 | null | 6
                 null | true | 6
                 8 | true | 8",
            ),
            Example::new(
                "a vector",
                "",
                "in | sample | out
                 [1.0, 2.0] | false | null
                 [3.0, 4.0] | true | [3.0, 4.0]
                 [5.0, 6.0] | false | [3.0, 4.0]",
            ),
        ],
        inputs: &[
            Port::new("in", PortType::Any, UnitRule::Var(0), "value to sample"),
            Port::bool("sample", "while true, the value is sampled"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "last sample",
        )],
        parameters: &[Parameter::new(
            "initial",
            ParameterKind::First(UnitRule::Var(0)),
            "value before the first sample",
        )
        .default(DefaultValue::Null)],
        memory: MemorySpec::values(1),
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, |frame, it| step(frame, Store::Real, it));
        }),
        Kernel::of(Store::Bool, |frame, operands| {
            each(frame, operands, |frame, it| step(frame, Store::Bool, it));
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, |frame, it| step(frame, Store::Int, it));
        }),
    ],
);

#[inline(always)]
fn step(
    frame: &mut Frame<'_>,
    store: Store,
    [input, sample, out, held, width]: [u32; 5],
) -> Option<()> {
    if frame.get_bool(sample)? == 1 && !is_null(frame, store, input, width)? {
        copy(frame, store, input, held, width)?;
    }
    copy(frame, store, held, out, width)
}
