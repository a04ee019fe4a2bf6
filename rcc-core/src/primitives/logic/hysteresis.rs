//! `Hysteresis`: a threshold that does not chatter: true above `high`, false below `low`, unchanged in between.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Real,
    Slot, Spec, StateSpec, Step, UnitRule, choose, operands,
};
use crate::types::{NULL_BOOL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Hysteresis",
        summary: "Becomes true when a number exceeds `high`, and false when it falls below `low`.",
        null: "a null input gives null and holds the state",
        undefined: "low above high",
        examples: &[Example::new(
            "unchanged between the bounds",
            "",
            "in | low | high | out
             1.5 | 1 | 2 | false
             2.1 | 1 | 2 | true
             1.5 | 1 | 2 | true
             null | 1 | 2 | null
             1.0 | 1 | 2 | true
             0.9 | 1 | 2 | false
             2.0 | 1 | 2 | false
             2.0 | 3 | 2 | null",
        )],
        inputs: &[
            Port::real("in", UnitRule::Var(0), "number to compare"),
            Port::real(
                "low",
                UnitRule::Var(0),
                "the output becomes false below this",
            ),
            Port::real(
                "high",
                UnitRule::Var(0),
                "the output becomes true above this",
            ),
        ],
        outputs: &[Port::bool("out", "state of the threshold")],
        parameters: &[Parameter::new(
            "initial",
            ParameterKind::Start(Type::Bool, UnitRule::Typed),
            "output for a number between the bounds before it was ever outside them",
        )
        .default(DefaultValue::Bool(false))],
        state: StateSpec {
            bools: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Hysteresis>()],
);

operands! {
    struct Hysteresis { input: Slot<Real>, low: Slot<Real>, high: Slot<Real>, out: Slot<Bool>, last: Slot<Bool> }
}

impl Step for Hysteresis {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        let known = !value.is_nan() & (low <= high);
        let now = choose(value > high, 1, choose(value < low, 0, before));
        frame.put(self.out, choose(known, now, NULL_BOOL))?;
        frame.put(self.last, choose(known, now, before))
    }
}
