//! `OnDelay`: on-delay timer: true once its input has been true for a time without interruption.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, StateSpec, Step, UnitRule,
    choose, elapsed, operands, reached, real_unless,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "OnDelay",
        summary: "True once its input has been true for a time; false as soon as it is false.",
        null: "a null `in` gives null and restarts the time; a null `time` gives null while the time continues",
        formula: "TON of IEC 61131-3, table 46: elapsed is 0 in the cycle of the rising edge",
        examples: &[Example::new(
            "2 ms at a period of 1 ms",
            "",
            "in | time | out | elapsed
             false | 2 ms | false | 0 s
             true | 2 ms | false | 0 s
             true | 2 ms | false | 1 ms
             true | 2 ms | true | 2 ms
             true | 2 ms | true | 2 ms
             false | 2 ms | false | 0 s
             true | 2 ms | false | 0 s
             null | 2 ms | null | null
             true | 2 ms | false | 0 s
             true | null | null | null
             true | 2 ms | true | 2 ms",
        )],
        inputs: &[
            Port::bool("in", "condition"),
            Port::real(
                "time",
                UnitRule::SECOND,
                "time for which the input must be true; 0 or less: no delay",
            ),
        ],
        outputs: &[
            Port::bool("out", "the condition has been true for the time"),
            Port::real(
                "elapsed",
                UnitRule::SECOND,
                "time for which the input has been true, at most `time`",
            )
            .diagnostic(),
        ],
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<OnDelay>()],
);

operands! {
    struct OnDelay { input: Slot<Bool>, time: Slot<Real>, out: Slot<Bool>, elapsed: Slot<Real>, age: Slot<Int> }
}

impl Step for OnDelay {
    /// `age`: cycles in which `in` has been true, including the current one; 0 while it is not.
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, time_s) = (frame.get(self.input)?, frame.get(self.time)?);
        let count = choose(value == 1, frame.get(self.age)?.saturating_add(1), 0);
        let cycles = count.saturating_sub(1).max(0);
        let null = (value & NULL_BOOL != 0) | time_s.is_nan();
        let is_over = (count > 0) & reached(cycles, frame.dt_s, time_s);
        let now = elapsed(cycles, frame.dt_s, if time_s > 0.0 { time_s } else { 0.0 });
        frame.put(self.age, count)?;
        frame.put(self.out, choose(null, NULL_BOOL, u8::from(is_over)))?;
        frame.put(self.elapsed, real_unless(null, now))
    }
}
