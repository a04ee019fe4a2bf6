//! `PeakHold`: the minimum and maximum of a number since the start or the last reset.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Port, Real, Slot, Spec, StateSpec, Step,
    UnitRule, higher, lower, operands, real_unless,
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
    &[Kernel::each::<PeakHold>()],
);

operands! {
    struct PeakHold {
        input: Slot<Real>, reset: Slot<Bool>, least: Slot<Real>, greatest: Slot<Real>, state: Slot<[Real; 2]>,
    }
}

impl Step for PeakHold {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, reset) = (frame.get(self.input)?, frame.get(self.reset)?);
        let [low, high] = frame.get(self.state)?;
        let null = value.is_nan() | (reset & NULL_BOOL != 0);
        // `lower` and `higher` ignore NaN, which is the initial state.
        let known = if reset == 1 {
            [value; 2]
        } else {
            [lower(low, value), higher(high, value)]
        };
        frame.put(self.least, real_unless(null, known[0]))?;
        frame.put(self.greatest, real_unless(null, known[1]))?;
        frame.put(self.state, if null { [low, high] } else { known })
    }
}
