//! `PeakHold`: the minimum and maximum of a number since the start or the last reset.

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
        summary: "The minimum and maximum of a number since the last reset.",
        null: "a null input gives null and holds the state",
        examples: &[Example::new(
            "a reset includes the number of its own cycle",
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
            Port::real("in", UnitRule::Var(0), "number"),
            Port::bool("reset", "discards everything before this cycle")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::real("least", UnitRule::Var(0), "minimum, including this cycle").diagnostic(),
            Port::real(
                "greatest",
                UnitRule::Var(0),
                "maximum, including this cycle",
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
    // `lower` and `higher` ignore NaN, which is the initial state.
    let known = if reset == 1 {
        [value; 2]
    } else {
        [lower(low, value), higher(high, value)]
    };
    frame.put_real(least, real_unless(null, known[0]))?;
    frame.put_real(greatest, real_unless(null, known[1]))?;
    frame.put_reals(state, if null { [low, high] } else { known })
}
