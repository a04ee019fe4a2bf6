//! `Debounce`: accepts a new value only after it has been stable for a time, as for a bouncing contact.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Int, Kernel, Parameter, Port, Real, Slot, Spec, StateSpec, Step,
    UnitRule, choose, operands, reached,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Debounce",
        summary: "Accepts a new value only after the input has differed from the output for a time without interruption.",
        null: "a null input gives null, keeps the value and restarts the time",
        examples: &[Example::new(
            "a change of 2 ms counts; the first value is accepted at once",
            "{time: 2 ms}",
            "in | out
             true | true
             false | true
             true | true
             false | true
             false | true
             false | false
             null | null
             true | false",
        )],
        inputs: &[Port::bool("in", "signal that may bounce")],
        outputs: &[Port::bool("out", "last stable value")],
        parameters: &[Parameter::real(
            "time",
            UnitRule::SECOND,
            "time for which a new value must be stable",
        )
        .at_least(0.0)],
        state: StateSpec {
            bools: 1,
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Debounce>()],
);

operands! {
    struct Debounce { input: Slot<Bool>, out: Slot<Bool>, time: Slot<Real>, last: Slot<Bool>, age: Slot<Int> }
}

impl Step for Debounce {
    /// `age`: cycles in which `in` has differed from `out`, including the current one.
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let null = value & NULL_BOOL != 0;
        let differs = !null & (value != before);
        let count = choose(differs, frame.get(self.age)?.saturating_add(1), 0);
        let stays = reached(count.saturating_sub(1), frame.dt_s, frame.get(self.time)?);
        let changes = differs & (stays | (before & NULL_BOOL != 0));
        let now = choose(changes, value, before);
        frame.put(self.age, choose(changes, 0, count))?;
        frame.put(self.last, now)?;
        frame.put(self.out, choose(null, NULL_BOOL, now))
    }
}
