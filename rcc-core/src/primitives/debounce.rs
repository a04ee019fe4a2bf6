//! `Debounce`: accepts a new value only after it has been stable for a time, as for a bouncing contact.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Parameter, Port, Spec, StateSpec, UnitRule, choose, each,
    reached,
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

/// `age`: cycles in which `in` has differed from `out`, including the current one.
#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out, time, last, age]: [u32; 5]) -> Option<()> {
    let (value, before) = (frame.get_bool(input)?, frame.get_bool(last)?);
    let null = value & NULL_BOOL != 0;
    let differs = !null & (value != before);
    let count = choose(differs, frame.get_int(age)?.saturating_add(1), 0);
    let stays = reached(count.saturating_sub(1), frame.dt_s, frame.get_real(time)?);
    let changes = differs & (stays | (before & NULL_BOOL != 0));
    let now = choose(changes, value, before);
    frame.put_int(age, choose(changes, 0, count))?;
    frame.put_bool(last, now)?;
    frame.put_bool(out, choose(null, NULL_BOOL, now))
}
