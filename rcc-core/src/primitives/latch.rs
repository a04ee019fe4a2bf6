//! `Latch`: set by `set`, cleared by `reset`, unchanged in between.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Spec, StateSpec,
    UnitRule, choose, each,
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [set, reset, out, set_wins, last]: [u32; 5]) -> Option<()> {
    let (set, reset) = (frame.get_bool(set)?, frame.get_bool(reset)?);
    let (wins, before) = (frame.get_bool(set_wins)?, frame.get_bool(last)?);
    let null = (set | reset) & NULL_BOOL != 0;
    let both = (set & reset & 1) & wins;
    // Set or held, and not reset unless set wins.
    let now = (set | before) & !reset & 1 | both;
    frame.put_bool(out, choose(null, NULL_BOOL, now))?;
    frame.put_bool(last, choose(null, before, now))
}
