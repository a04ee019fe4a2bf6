//! `OffDelay`: off-delay timer: stays true for a time after its input becomes false.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, StateSpec, Step, UnitRule,
    choose, elapsed, operands, reached, real_unless,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "OffDelay",
        summary: "True while its input is true, and for a time afterwards.",
        null: "a null `in` gives null and ends the time, so that the output is false until `in` is true again; a null `time` gives null while the time continues",
        formula: "TOF of IEC 61131-3, table 46: elapsed is 0 in the cycle of the falling edge",
        examples: &[Example::new(
            "2 ms at a period of 1 ms",
            "",
            "in | time | out | elapsed
             false | 2 ms | false | 0 s
             true | 2 ms | true | 0 s
             false | 2 ms | true | 0 s
             false | 2 ms | true | 1 ms
             false | 2 ms | false | 2 ms
             false | 2 ms | false | 2 ms
             true | 2 ms | true | 0 s
             null | 2 ms | null | null
             false | 2 ms | false | 0 s",
        )],
        inputs: &[
            Port::bool("in", "condition"),
            Port::real(
                "time",
                UnitRule::SECOND,
                "time for which the output stays true afterwards; 0 or less: none",
            ),
        ],
        outputs: &[
            Port::bool(
                "out",
                "the condition is true, or was true less than `time` ago",
            ),
            Port::real(
                "elapsed",
                UnitRule::SECOND,
                "time since it became false, at most `time`",
            )
            .diagnostic(),
        ],
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<OffDelay>()],
);

operands! {
    struct OffDelay { input: Slot<Bool>, time: Slot<Real>, out: Slot<Bool>, elapsed: Slot<Real>, age: Slot<Int> }
}

impl Step for OffDelay {
    /// `age`: 0 before `in` was ever true, 1 while it is true, then incremented every cycle.
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, time_s) = (frame.get(self.input)?, frame.get(self.time)?);
        let before = frame.get(self.age)?;
        let later = choose(before > 0, before.saturating_add(1), 0);
        let unknown = value & NULL_BOOL != 0;
        let count = choose(unknown, 0, choose(value == 1, 1, later));
        let cycles = count.saturating_sub(2).max(0);
        let null = unknown | time_s.is_nan();
        let runs_on = (count > 1) & !reached(cycles, frame.dt_s, time_s);
        let now = elapsed(cycles, frame.dt_s, if time_s > 0.0 { time_s } else { 0.0 });
        frame.put(self.age, count)?;
        frame.put(
            self.out,
            choose(null, NULL_BOOL, u8::from((count == 1) | runs_on)),
        )?;
        frame.put(self.elapsed, real_unless(null, now))
    }
}
