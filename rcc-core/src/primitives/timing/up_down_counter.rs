//! `UpDownCounter`: counts the rising edges of one signal up and those of another down.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Int, Kernel, Port, Slot, Spec, StateSpec, Step,
    choose, operands,
};
use crate::types::{NULL_BOOL, NULL_INT};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "UpDownCounter",
        summary: "Counts rising edges up and down, with reset and load.",
        null: "a null input gives null outputs and holds the count; the last known value of a signal stays remembered",
        formula: "CTUD of IEC 61131-3, table 45: reset comes before load, load before counting; saturates at ±(2^63 - 1)",
        examples: &[
            Example::new(
                "two counts up, one down, load and reset; the first value is not an edge",
                "",
                "up | down | reset | load | preset | count | full | empty
                 true | false | false | false | 2 | 0 | false | true
                 false | false | false | false | 2 | 0 | false | true
                 true | false | false | false | 2 | 1 | false | false
                 true | true | false | false | 2 | 0 | false | true
                 false | false | false | true | 2 | 2 | true | false
                 null | false | false | false | 2 | null | null | null
                 true | false | false | false | 2 | 3 | true | false
                 false | false | true | true | 2 | 0 | false | true",
            ),
            Example::new(
                "both at once",
                "",
                "up | down | count\n false | false | 0\n true | true | 0",
            ),
        ],
        inputs: &[
            Port::bool("up", "signal whose rising edges count up"),
            Port::bool("down", "signal whose rising edges count down")
                .default(DefaultValue::Bool(false)),
            Port::bool("reset", "sets the count to 0").default(DefaultValue::Bool(false)),
            Port::bool("load", "sets the count to `preset`").default(DefaultValue::Bool(false)),
            Port::int("preset", "count to load, and threshold of the upper output")
                .default(DefaultValue::Int(0)),
        ],
        outputs: &[
            Port::int("count", "edges up minus edges down; 0 at the start"),
            Port::bool("full", "the count is at least `preset`").diagnostic(),
            Port::bool("empty", "the count is at most 0").diagnostic(),
        ],
        state: StateSpec {
            // up, down
            bools: 2,
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<UpDownCounter>()],
);

operands! {
    struct UpDownCounter {
        up: Slot<Bool>, down: Slot<Bool>, reset: Slot<Bool>, load: Slot<Bool>, preset: Slot<Int>,
        count: Slot<Int>, full: Slot<Bool>, empty: Slot<Bool>, last: Slot<Bool>, state: Slot<Int>,
    }
}

impl Step for UpDownCounter {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (up, down) = (frame.get(self.up)?, frame.get(self.down)?);
        let (reset, load) = (frame.get(self.reset)?, frame.get(self.load)?);
        let preset = frame.get(self.preset)?;
        let edge = |frame: &mut Frame<'_>, slot: Slot<Bool>, now: u8| {
            let before = frame.get(slot)?;
            frame.put(slot, choose(now & NULL_BOOL != 0, before, now))?;
            Some(i64::from((now == 1) & (before == 0)))
        };
        let change = edge(frame, self.last, up)? - edge(frame, self.last + 1, down)?;
        let null = ((up | down | reset | load) & NULL_BOOL != 0) | (preset == NULL_INT);
        let before = frame.get(self.state)?;
        let counted = before.saturating_add(change).max(-i64::MAX);
        let set = choose(reset == 1, 0, choose(load == 1, preset, counted));
        let now = choose(null, before, set);
        frame.put(self.state, now)?;
        frame.put(self.count, choose(null, NULL_INT, now))?;
        frame.put(self.full, choose(null, NULL_BOOL, u8::from(now >= preset)))?;
        frame.put(self.empty, choose(null, NULL_BOOL, u8::from(now <= 0)))
    }
}
