//! `Derivative`: the rate of change of a number, smoothed with a time constant.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, Port, Real, Slot, Spec, StateSpec,
    Step, UnitRule, finite, operands,
};
use crate::types::NULL_REAL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Derivative",
        summary: "The rate of change of a number, smoothed by a first-order low-pass filter.",
        null: "a null input gives null and resets the filter: the next known input gives 0",
        undefined: "overflow",
        formula: "out += (Δin - out · dt) / (T + dt), that is s / (1 + T s) by backward differences (Åström and \
                  Hägglund, Advanced PID Control, 2006, 13.3)",
        examples: &[
            Example::new(
                "unfiltered: the difference of two cycles",
                "",
                "in | out\n 1 | 0\n 1.5 | 5\n 1.4 | -1\n null | null\n 7 | 0\n 7.1 | 1",
            )
            .every_ms(100),
            Example::new(
                "a ramp of 1 per second, with a time constant of one period",
                "{time_constant: 0.1 s}",
                "in | out\n 0 | 0\n 0.1 | 0.5\n 0.2 | 0.75\n 0.3 | 0.875",
            )
            .every_ms(100),
        ],
        inputs: &[Port::real("in", UnitRule::Var(0), "number")],
        outputs: &[Port::real(
            "out",
            UnitRule::PerSecond(0),
            "rate of change, per second; 0 in the first cycle",
        )],
        parameters: &[Parameter::real(
            "time_constant",
            UnitRule::SECOND,
            "time constant T of the filter; 0: no filter",
        )
        .default(DefaultValue::Real(0.0))
        .at_least(0.0)],
        // last input, last output
        state: StateSpec {
            reals: 2,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Derivative>()],
);

operands! {
    struct Derivative { input: Slot<Real>, out: Slot<Real>, time_constant: Slot<Real>, state: Slot<[Real; 2]> }
}

impl Step for Derivative {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, dt_s) = (frame.get(self.input)?, frame.dt_s);
        let [last, rate] = frame.get(self.state)?;
        let moved = rate + (value - last - rate * dt_s) / (frame.get(self.time_constant)? + dt_s);
        let now = finite(if last.is_nan() & value.is_finite() {
            0.0
        } else {
            moved
        });
        frame.put(self.out, now)?;
        frame.put(
            self.state,
            if now.is_nan() {
                [NULL_REAL; 2]
            } else {
                [value, now]
            },
        )
    }
}
