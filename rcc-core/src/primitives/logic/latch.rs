//! `Latch`: set by `set`, cleared by `reset`, unchanged in between.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Slot,
    Spec, StateSpec, Step, UnitRule, choose, operands,
};
use crate::types::{NULL_BOOL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Latch",
        summary: "Becomes true on one condition and false on another, and keeps its state in between.",
        null: "a null input gives null and holds the state",
        formula: "RS of IEC 61131-3, table 43; with set_wins SR",
        examples: &[
            Example::new(
                "reset wins",
                "",
                "set | reset | out
                 false | false | false
                 true | false | true
                 false | false | true
                 null | false | null
                 false | null | null
                 false | false | true
                 true | true | false
                 false | false | false",
            ),
            Example::new(
                "set wins",
                "{set_wins: true}",
                "set | reset | out\n true | true | true\n false | true | false",
            ),
            Example::new(
                "initially true",
                "{initial: true}",
                "set | reset | out\n false | false | true",
            ),
        ],
        inputs: &[
            Port::bool("set", "sets the output to true"),
            Port::bool("reset", "sets the output to false"),
        ],
        outputs: &[Port::bool("out", "state, updated in the same cycle")],
        parameters: &[
            Parameter::bool(
                "set_wins",
                "priority if both are true: true sets, false resets",
            )
            .default(DefaultValue::Bool(false)),
            Parameter::new(
                "initial",
                ParameterKind::Start(Type::Bool, UnitRule::Typed),
                "value before the first cycle",
            )
            .default(DefaultValue::Bool(false)),
        ],
        state: StateSpec {
            bools: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Latch>()],
);

operands! {
    struct Latch { set: Slot<Bool>, reset: Slot<Bool>, out: Slot<Bool>, set_wins: Slot<Bool>, last: Slot<Bool> }
}

impl Step for Latch {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (set, reset) = (frame.get(self.set)?, frame.get(self.reset)?);
        let (wins, before) = (frame.get(self.set_wins)?, frame.get(self.last)?);
        let null = (set | reset) & NULL_BOOL != 0;
        let both = (set & reset & 1) & wins;
        // Set or held, and not reset unless set wins.
        let now = (set | before) & !reset & 1 | both;
        frame.put(self.out, choose(null, NULL_BOOL, now))?;
        frame.put(self.last, choose(null, before, now))
    }
}
