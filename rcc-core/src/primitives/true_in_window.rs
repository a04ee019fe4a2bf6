//! `TrueInWindow`: counts how often a condition was true recently, with a ring of the last Bools and their count:
//! constant work in every cycle.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, MemorySpec, Parameter, ParameterKind, Port,
    Spec, StateSpec, choose, each,
};
use crate::types::{NULL_BOOL, NULL_INT, Store};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "TrueInWindow",
        summary: "Counts the cycles of a sliding window in which a condition was true.",
        null: "null while the window contains a null condition; before the first cycle the condition counts as false",
        inputs: &[Port::bool("in", "condition")],
        outputs: &[
            Port::bool("all", "true in all cycles of the window").diagnostic(),
            Port::bool("any", "true in at least one cycle of the window").diagnostic(),
            Port::int("count", "number of cycles in which it was true").diagnostic(),
        ],
        parameters: &[Parameter::new(
            "window",
            ParameterKind::Window,
            "length of the window, including the current cycle; 1 to 10 000 cycles of the net",
        )
        .above(0.0)],
        state: StateSpec {
            ints: 3,
            ..StateSpec::NONE
        },
        memory: MemorySpec::window(1)
            .of(Store::Bool)
            .starting(DefaultValue::Bool(false)),
        examples: &[Example::new(
            "a window of three cycles",
            "{window: 3 ms}",
            "in | all | any | count
             true | false | true | 1
             true | false | true | 2
             true | true | true | 3
             false | false | true | 2
             null | null | null | null
             false | null | null | null
             false | null | null | null
             false | false | false | 0",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(
    frame: &mut Frame<'_>,
    [input, all, any, count, ints, ring, cycles]: [u32; 7],
) -> Option<()> {
    let place = u32::try_from(frame.get_int(ints)?).ok()?;
    let place = place.min(cycles.saturating_sub(1));
    let (new, old) = (frame.get_bool(input)?, frame.get_bool(ring + place)?);
    frame.put_bool(ring + place, new)?;
    let change = i64::from(new & 1) - i64::from(old & 1);
    let trues = frame.get_int(ints + 1)?.saturating_add(change);
    let nulls = |value: u8| i64::from(value & NULL_BOOL != 0);
    let change = nulls(new) - nulls(old);
    let unknown = frame.get_int(ints + 2)?.saturating_add(change);
    frame.put_int(ints + 1, trues)?;
    frame.put_int(ints + 2, unknown)?;
    let next = if place + 1 < cycles { place + 1 } else { 0 };
    frame.put_int(ints, i64::from(next))?;
    let null = unknown != 0;
    let whole = u8::from(trues == i64::from(cycles));
    frame.put_bool(all, choose(null, NULL_BOOL, whole))?;
    frame.put_bool(any, choose(null, NULL_BOOL, u8::from(trues > 0)))?;
    frame.put_int(count, choose(null, NULL_INT, trues))
}
