//! `Hold`: sample and hold of any value.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Element, Example, Int, Kernel, MemorySpec, NullRule,
    Parameter, ParameterKind, Port, PortType, Real, Slot, Spec, Step, UnitRule, copy, is_null,
    operands,
};

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
        Kernel::each::<Hold<Real>>(),
        Kernel::each::<Hold<Bool>>(),
        Kernel::each::<Hold<Int>>(),
    ],
);

operands! {
    struct Hold<E> { input: Slot<E>, sample: Slot<Bool>, out: Slot<E>, held: Slot<E>, width: u32 }
}

impl<E: Element> Step for Hold<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let samples = frame.get(self.sample)? == 1;
        if samples && !is_null(frame, self.input, self.width)? {
            copy(frame, self.input, self.held, self.width)?;
        }
        copy(frame, self.held, self.out, self.width)
    }
}
