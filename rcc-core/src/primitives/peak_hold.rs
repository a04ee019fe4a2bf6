//! `PeakHold`: the least and the greatest number since the beginning or the last reset.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Port, Spec, StateSpec, UnitRule, each, higher,
    lower, real_unless,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "PeakHold",
        summary: "The least and the largest value of a number since the last reset.",
        null: "a null input gives null and holds the state",
        examples: &[Example::new(
            "a reset begins with the number of its own cycle",
            "",
            "in | reset | least | greatest
             2 | false | 2 | 2
             5 | false | 2 | 5
             -1 | false | -1 | 5
             null | false | null | null
             3 | false | -1 | 5
             4 | true | 4 | 4
             3 | false | 3 | 4",
        )],
        inputs: &[
            Port::real("in", UnitRule::Var(0), "number to watch"),
            Port::bool("reset", "forgets what was before this cycle")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::real(
                "least",
                UnitRule::Var(0),
                "least value, this cycle included",
            )
            .diagnostic(),
            Port::real(
                "greatest",
                UnitRule::Var(0),
                "largest value, this cycle included",
            )
            .diagnostic(),
        ],
        // least, greatest
        state: StateSpec {
            reals: 2,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, reset, least, greatest, state]: [u32; 5]) -> Option<()> {
    let (value, reset) = (frame.get_real(input)?, frame.get_bool(reset)?);
    let [low, high] = frame.get_reals(state)?;
    let null = value.is_nan() | (reset & NULL_BOOL != 0);
    // `lower` and `higher` pass over NaN, the state in the beginning.
    let known = if reset == 1 {
        [value; 2]
    } else {
        [lower(low, value), higher(high, value)]
    };
    frame.put_real(least, real_unless(null, known[0]))?;
    frame.put_real(greatest, real_unless(null, known[1]))?;
    frame.put_reals(state, if null { [low, high] } else { known })
}
