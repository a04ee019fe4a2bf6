//! `Counter`: the number of cycles in which a condition was true.
//!
//! After a `RisingEdge` it counts events.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Int, Kernel, Port, Slot, Spec, StateSpec, Step, choose, operands,
};
use crate::types::{NULL_BOOL, NULL_INT};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Counter",
        summary: "Counts the cycles in which its input is true, including the current one.",
        null: "a null input gives null and is not counted",
        examples: &[Example::new(
            "null is not counted",
            "",
            "
            in    | out
            false | 0
            true  | 1
            true  | 2
            null  | null
            true  | 3
        ",
        )],
        inputs: &[Port::bool("in", "condition to count")],
        outputs: &[Port::int(
            "out",
            "number of cycles so far; 0 before the first",
        )],
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Counter>()],
);

operands! {
    struct Counter { input: Slot<Bool>, out: Slot<Int>, count: Slot<Int> }
}

impl Step for Counter {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        // At a cycle of 125 µs it would overflow after 36 million years.
        let counted = frame.get(self.count)?.saturating_add(i64::from(value & 1));
        let null = value & NULL_BOOL != 0;
        frame.put(self.out, choose(null, NULL_INT, counted))?;
        frame.put(self.count, counted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn counts_true_cycles_and_nothing_else() {
        let mut bench = PrimitiveHarness::new("Counter");
        let (no, yes) = (Some(false), Some(true));
        for (input, out) in [
            (no, 0),
            (yes, 1),
            (yes, 2),
            (None, NULL_INT),
            (no, 2),
            (yes, 3),
        ] {
            assert_eq!(bench.set_bool("in", input).step().int("out"), out);
        }
    }
}
