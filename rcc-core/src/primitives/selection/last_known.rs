//! `LastKnown`: the last value that was not null, of any type. For nets in which a slightly old value is better than
//! null; a device must never be commanded with it.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Element, Example, Int, Kernel, MemorySpec, NullRule,
    Parameter, ParameterKind, Port, PortType, Real, Slot, Spec, Step, UnitRule, copy, is_null,
    operands,
};

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
        Kernel::each::<LastKnown<Real>>(),
        Kernel::each::<LastKnown<Bool>>(),
        Kernel::each::<LastKnown<Int>>(),
    ],
);

operands! {
    struct LastKnown<E> { input: Slot<E>, out: Slot<E>, memory: Slot<E>, width: u32 }
}

impl<E: Element> Step for LastKnown<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        if !is_null(frame, self.input, self.width)? {
            copy(frame, self.input, self.memory, self.width)?;
        }
        copy(frame, self.memory, self.out, self.width)
    }
}
