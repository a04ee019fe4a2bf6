//! `TrueInWindow`: counts how often a condition was true recently, with a ring of the last Bools and their count:
//! constant work in every cycle.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Int, Kernel, MemorySpec, Parameter, ParameterKind,
    Port, Slot, Spec, StateSpec, Step, choose, operands,
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
    &[Kernel::each::<TrueInWindow>()],
);

operands! {
    struct TrueInWindow {
        input: Slot<Bool>, all: Slot<Bool>, any: Slot<Bool>, count: Slot<Int>, ints: Slot<Int>,
        ring: Slot<Bool>, cycles: u32,
    }
}

impl Step for TrueInWindow {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let TrueInWindow { cycles, .. } = self;
        let place = u32::try_from(frame.get(self.ints)?).ok()?;
        let place = place.min(cycles.saturating_sub(1));
        let (new, old) = (frame.get(self.input)?, frame.get(self.ring + place)?);
        frame.put(self.ring + place, new)?;
        let change = i64::from(new & 1) - i64::from(old & 1);
        let trues = frame.get(self.ints + 1)?.saturating_add(change);
        let nulls = |value: u8| i64::from(value & NULL_BOOL != 0);
        let change = nulls(new) - nulls(old);
        let unknown = frame.get(self.ints + 2)?.saturating_add(change);
        frame.put(self.ints + 1, trues)?;
        frame.put(self.ints + 2, unknown)?;
        let next = if place + 1 < cycles { place + 1 } else { 0 };
        frame.put(self.ints, i64::from(next))?;
        let null = unknown != 0;
        let whole = u8::from(trues == i64::from(cycles));
        frame.put(self.all, choose(null, NULL_BOOL, whole))?;
        frame.put(self.any, choose(null, NULL_BOOL, u8::from(trues > 0)))?;
        frame.put(self.count, choose(null, NULL_INT, trues))
    }
}
