//! `LowPass`: a first-order low-pass filter, y += (x - y) · gain at each evaluation.
//!
//! For a time constant T and a period dt the gain is 1 - exp(-dt / T).

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, Real, Slot,
    Spec, StateSpec, Step, UnitRule, operands,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "LowPass",
        summary: "Smooths a number by a first-order low-pass filter.",
        null: "a null input gives null and holds the state: it then continues from the last output",
        undefined: "overflow",
        formula: "y += (x - y) * gain; gain = 1 - exp(-dt / T) for a time constant T",
        examples: &[Example::new(
            "a gain of a quarter",
            "{gain: 0.25}",
            "
                in   | out
                4    | 1
                4    | 1.75
                null | null
                4    | 2.3125
            ",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to smooth")],
        outputs: &[Port::real("out", UnitRule::Var(0), "smoothed number")],
        parameters: &[
            Parameter::real(
                "gain",
                UnitRule::Is(Unit::ONE),
                "part of the difference that is added in each cycle; 1 follows at once",
            )
            .above(0.0)
            .at_most(1.0),
            Parameter::new(
                "initial",
                ParameterKind::Start(Type::Real, UnitRule::Var(0)),
                "output before the first cycle; null: starts at the first known input",
            )
            .default(DefaultValue::Real(0.0)),
        ],
        state: StateSpec {
            reals: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<LowPass>()],
);

operands! {
    struct LowPass { input: Slot<Real>, out: Slot<Real>, gain: Slot<Real>, last: Slot<Real> }
}

impl Step for LowPass {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let moved = before + (value - before) * frame.get(self.gain)?;
        // Without a state, at the start or after an overflow, it starts at the input.
        let now = if before.is_nan() { value } else { moved };
        // A null input makes the result NaN.
        frame.put(self.out, now)?;
        frame.put(self.last, if value.is_nan() { before } else { now })
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn adds_a_part_of_the_difference_in_each_cycle() {
        let mut bench = PrimitiveHarness::new("LowPass");
        bench
            .start_real(0.0)
            .set_real("gain", 0.25)
            .set_real("in", 4.0);
        let out: [f64; 3] = core::array::from_fn(|_| bench.step().real("out"));
        assert_eq!(out, [1.0, 1.75, 2.3125]);
    }

    #[test]
    fn without_an_initial_value_it_begins_at_the_first_known_input() {
        let mut bench = PrimitiveHarness::new("LowPass");
        bench.set_real("gain", 0.5);
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        assert_eq!(bench.set_real("in", 4.0).step().real("out"), 4.0);
        assert_eq!(bench.set_real("in", 2.0).step().real("out"), 3.0);
    }

    #[test]
    fn null_holds_the_state() {
        let mut bench = PrimitiveHarness::new("LowPass");
        bench
            .start_real(0.0)
            .set_real("gain", 0.5)
            .set_real("in", 2.0)
            .step();
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        assert_eq!(bench.set_real("in", 2.0).step().real("out"), 1.5);
    }

    #[test]
    fn an_overflow_has_no_lasting_effect() {
        let mut bench = PrimitiveHarness::new("LowPass");
        bench.start_real(-1e308).set_real("gain", 0.5);
        assert!(bench.set_real("in", 1e308).step().real("out").is_nan());
        assert_eq!(bench.set_real("in", 2.0).step().real("out"), 2.0);
    }
}
