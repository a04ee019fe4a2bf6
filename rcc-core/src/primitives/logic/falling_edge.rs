//! `FallingEdge`: true in the cycle in which its input changes from true to false.
//!
//! There is no edge in the first cycle, unless `initial` gives the value before it.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Slot,
    Spec, StateSpec, Step, UnitRule, choose, operands,
};
use crate::types::{NULL_BOOL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "FallingEdge",
        summary: "True for one cycle when its input becomes false.",
        null: "a null input gives null; the last known value is kept",
        formula: "F_TRIG of IEC 61131-3, table 44, but null instead of false before the first cycle",
        examples: &[
            Example::new(
                "only a change counts, also across null",
                "",
                "in | out
                 false | false
                 true | false
                 false | true
                 false | false
                 true | false
                 null | null
                 false | true",
            ),
            Example::new(
                "initially true",
                "{initial: true}",
                "in | out\n false | true\n false | false",
            ),
        ],
        inputs: &[Port::bool("in", "signal to watch")],
        outputs: &[Port::bool("out", "true in the cycle of the change")],
        parameters: &[Parameter::new(
            "initial",
            ParameterKind::Start(Type::Bool, UnitRule::Typed),
            "value before the first cycle; null: no edge at the first known value",
        )
        .default(DefaultValue::Null)],
        state: StateSpec {
            bools: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<FallingEdge>()],
);

operands! {
    struct FallingEdge { input: Slot<Bool>, out: Slot<Bool>, last: Slot<Bool> }
}

impl Step for FallingEdge {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (now, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let null = now & NULL_BOOL != 0;
        let edge = u8::from((now == 0) & (before == 1));
        frame.put(self.out, choose(null, NULL_BOOL, edge))?;
        frame.put(self.last, choose(null, before, now))
    }
}
