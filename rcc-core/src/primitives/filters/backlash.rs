//! `Backlash`: mechanical play: the output moves only when the input pushes it.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Real, Slot,
    Spec, StateSpec, Step, UnitRule, finite, higher, lower, operands,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Backlash",
        summary: "Follows a number with play: the output moves only when the number reaches the end of the play.",
        null: "a null input gives null and holds the state",
        undefined: "overflow",
        formula: "out is the number nearest to the last out in [in - width / 2, in + width / 2] (play operator; Visintin, \
                  Differential Models of Hysteresis, 1994, III.2)",
        examples: &[Example::new(
            "play of 2",
            "{width: 2}",
            "in | out
             0 | 0
             0.5 | 0
             3 | 2
             2 | 2
             null | null
             0.5 | 1.5",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to follow")],
        outputs: &[Port::real("out", UnitRule::Var(0), "followed number")],
        parameters: &[
            Parameter::real("width", UnitRule::Var(0), "total width of the play").at_least(0.0),
            Parameter::new(
                "initial",
                ParameterKind::Start(Type::Real, UnitRule::Var(0)),
                "output before the first cycle; null: starts at the first known input",
            )
            .default(DefaultValue::Null),
        ],
        state: StateSpec {
            reals: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Backlash>()],
);

operands! {
    struct Backlash { input: Slot<Real>, out: Slot<Real>, width: Slot<Real>, last: Slot<Real> }
}

impl Step for Backlash {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let half = frame.get(self.width)? / 2.0;
        let pushed = lower(higher(before, value - half), value + half);
        // `lower` and `higher` ignore NaN, so that without a state or with a null input there is nothing to hold back.
        let now = finite(if before.is_nan() | value.is_nan() {
            value
        } else {
            pushed
        });
        frame.put(self.out, now)?;
        frame.put(self.last, if now.is_nan() { before } else { now })
    }
}
