//! `Pulse`: a pulse of fixed length, however long its input is true.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, StateSpec, Step, UnitRule,
    choose, elapsed, operands, reached, real_unless,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Pulse",
        summary: "True for a time after its input becomes true; further edges in that time are ignored.",
        null: "a null input gives null; a pulse that has started continues, and the last known value is kept",
        formula: "TP of IEC 61131-3, table 46, except that the first known value is not an edge",
        examples: &[Example::new(
            "3 ms at a period of 1 ms",
            "",
            "in | time | out | elapsed
             false | 3 ms | false | 0 s
             true | 3 ms | true | 0 s
             false | 3 ms | true | 1 ms
             true | 3 ms | true | 2 ms
             true | 3 ms | false | 0 s
             false | 3 ms | false | 0 s
             true | 3 ms | true | 0 s
             null | 3 ms | null | null
             true | 3 ms | true | 2 ms
             true | 3 ms | false | 0 s",
        )],
        inputs: &[
            Port::bool("in", "signal whose rising edges start a pulse"),
            Port::real(
                "time",
                UnitRule::SECOND,
                "length of the pulse; 0 or less: no pulse",
            ),
        ],
        outputs: &[
            Port::bool("out", "a pulse is active"),
            Port::real(
                "elapsed",
                UnitRule::SECOND,
                "elapsed time of the pulse; 0 without a pulse",
            )
            .diagnostic(),
        ],
        state: StateSpec {
            bools: 1,
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Pulse>()],
);

operands! {
    struct Pulse {
        input: Slot<Bool>, time: Slot<Real>, out: Slot<Bool>, elapsed: Slot<Real>, last: Slot<Bool>,
        age: Slot<Int>,
    }
}

impl Step for Pulse {
    /// `age`: cycles of the pulse, including the current one; 0 without a pulse.
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, time_s) = (frame.get(self.input)?, frame.get(self.time)?);
        let (before, age_before) = (frame.get(self.last)?, frame.get(self.age)?);
        let unknown = value & NULL_BOOL != 0;
        let (edge, dt_s) = ((value == 1) & (before == 0), frame.dt_s);
        let older = age_before.saturating_add(1);
        let continues = (age_before > 0) & !reached(age_before, dt_s, time_s);
        let begins = edge & !reached(0, dt_s, time_s) & !time_s.is_nan();
        let count = choose(continues, older, i64::from(begins));
        let null = unknown | time_s.is_nan();
        let now = elapsed(count.saturating_sub(1).max(0), dt_s, time_s);
        frame.put(self.last, choose(unknown, before, value))?;
        frame.put(self.age, count)?;
        frame.put(self.out, choose(null, NULL_BOOL, u8::from(count > 0)))?;
        frame.put(
            self.elapsed,
            real_unless(null, if count > 0 { now } else { 0.0 }),
        )
    }
}
