//! `Trigger`: switches on once and off once; only `reset` re-arms it. It guards actions that must not happen twice.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Int, Kernel, Port, Slot, Spec, StateSpec, Step,
    choose, operands,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Trigger",
        summary: "Switches on once and then off permanently, until it is reset.",
        null: "a null input gives null and holds the state",
        examples: &[Example::new(
            "off is final; `off` wins over `on`, and `reset` over both",
            "",
            "on | off | reset | out
             false | false | false | false
             true | false | false | true
             false | false | false | true
             null | false | false | null
             false | true | false | false
             true | false | false | false
             true | false | true | false
             true | false | false | true
             true | true | false | false",
        )],
        inputs: &[
            Port::bool("on", "switches the output on, if it was never switched off"),
            Port::bool(
                "off",
                "switches the output off permanently, even before it was on",
            ),
            Port::bool("reset", "restores the initial state").default(DefaultValue::Bool(false)),
        ],
        outputs: &[Port::bool("out", "on")],
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Trigger>()],
);

const READY: i64 = 0;
const ON: i64 = 1;
const OVER: i64 = 2;

operands! {
    struct Trigger { on: Slot<Bool>, off: Slot<Bool>, reset: Slot<Bool>, out: Slot<Bool>, phase: Slot<Int> }
}

impl Step for Trigger {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (on, off, reset) = (
            frame.get(self.on)?,
            frame.get(self.off)?,
            frame.get(self.reset)?,
        );
        let before = frame.get(self.phase)?;
        let null = (on | off | reset) & NULL_BOOL != 0;
        let switched = choose((on == 1) & (before == READY), ON, before);
        let ended = choose(off == 1, OVER, switched);
        let now = choose(null, before, choose(reset == 1, READY, ended));
        frame.put(self.out, choose(null, NULL_BOOL, u8::from(now == ON)))?;
        frame.put(self.phase, now)
    }
}
