//! `Toggle`: inverts its output each time its input becomes true, like the push button of a lamp.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Int, Kernel, Parameter, Port, Slot, Spec,
    StateSpec, Step, choose, operands,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Toggle",
        summary: "Inverts its output in each cycle in which its input becomes true.",
        null: "a null input gives null and holds the state; the last known value is kept",
        examples: &[Example::new(
            "a button pressed twice; the first value is not an edge",
            "",
            "in | out
             true | false
             false | false
             true | true
             true | true
             null | null
             false | true
             true | false",
        )],
        inputs: &[Port::bool("in", "signal whose rising edges count")],
        outputs: &[Port::bool(
            "out",
            "state, inverted with each edge in the same cycle",
        )],
        parameters: &[Parameter::bool("initial", "value before the first edge")
            .default(DefaultValue::Bool(false))],
        state: StateSpec {
            bools: 1,
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Toggle>()],
);

operands! {
    struct Toggle { input: Slot<Bool>, out: Slot<Bool>, initial: Slot<Bool>, last: Slot<Bool>, turned: Slot<Int> }
}

impl Step for Toggle {
    /// `turned`: 1 after an odd number of edges.
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (now, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let null = now & NULL_BOOL != 0;
        let edge = (now == 1) & (before == 0);
        let turned_now = (frame.get(self.turned)? ^ i64::from(edge)) & 1;
        let value = (frame.get(self.initial)? ^ u8::from(turned_now == 1)) & 1;
        frame.put(self.turned, turned_now)?;
        frame.put(self.out, choose(null, NULL_BOOL, value))?;
        frame.put(self.last, choose(null, before, now))
    }
}
