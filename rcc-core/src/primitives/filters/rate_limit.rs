//! `RateLimit`: follows a number with a limited rate.
//!
//! In each cycle `out += min(max(in - out, -rate·dt), rate·dt)`. The output starts at `initial`; without it at the first
//! known input, so that a net does not start with an arbitrary ramp.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, PortType, Real,
    Slot, Spec, StateSpec, Step, UnitRule, operands,
};
use crate::types::{NULL_REAL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RateLimit",
        summary: "Follows a number with a limited rate of change.",
        null: "a null input gives null and holds the state: it then continues from the last output",
        undefined: "overflow",
        formula: "out += in - out, limited to ±rate · dt",
        examples: &[
            Example::new(
                "10 per second, every 0.1 s; starts at the first value",
                "{rate: 10}",
                "in | out
                 5 | 5
                 7.5 | 6
                 7.5 | 7
                 7.5 | 7.5
                 null | null
                 0 | 6.5",
            )
            .every_ms(100),
            Example::new(
                "the same, from 3: a step at the start is limited, too",
                "{rate: 10, initial: 3}",
                "in | out
                 5 | 4
                 5 | 5
                 5 | 5",
            )
            .every_ms(100),
        ],
        inputs: &[Port::real("in", UnitRule::Var(0), "number to follow")],
        outputs: &[Port::real("out", UnitRule::Var(0), "followed number")],
        parameters: &[
            Parameter::new(
                "rate",
                ParameterKind::Value(PortType::Is(Type::Real), UnitRule::PerSecond(0)),
                "largest change per second",
            )
            .above(0.0),
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
    &[Kernel::each::<RateLimit>()],
);

operands! {
    struct RateLimit { input: Slot<Real>, out: Slot<Real>, rate: Slot<Real>, last: Slot<Real> }
}

impl Step for RateLimit {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (target, before) = (frame.get(self.input)?, frame.get(self.last)?);
        let largest = frame.get(self.rate)? * frame.dt_s;
        let change = target - before;
        let limited = if change > largest {
            before + largest
        } else if change < -largest {
            before - largest
        } else {
            target
        };
        let known = if before.is_nan() { target } else { limited };
        let null = target.is_nan();
        frame.put(self.out, if null { NULL_REAL } else { known })?;
        frame.put(self.last, if null { before } else { known })
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn never_exceeds_the_rate() {
        let mut bench = PrimitiveHarness::new("RateLimit");
        bench.set_real("rate", 2.0);
        let mut last = bench.set_real("in", 0.5).step().real("out");
        assert_eq!(last, 0.5, "the first input is taken as it is");
        for target in [10.0, 10.0, -10.0, -10.0, 0.5, f64::MAX, f64::MIN] {
            let out = bench.set_real("in", target).step().real("out");
            assert!(
                (out - last).abs() <= 2e-3 * (1.0 + 1e-12),
                "{last} to {out}"
            );
            last = out;
        }
    }

    #[test]
    fn arrives_exactly() {
        let mut bench = PrimitiveHarness::new("RateLimit");
        bench.set_real("rate", 1.0).set_real("in", 0.0).step();
        bench.set_real("in", 0.0025);
        let out: [f64; 4] = core::array::from_fn(|_| bench.step().real("out"));
        assert_eq!(out, [0.001, 0.002, 0.0025, 0.0025]);
    }

    #[test]
    fn starts_at_its_initial_value() {
        let mut bench = PrimitiveHarness::new("RateLimit");
        bench.start_real(0.5).set_real("rate", 1.0);
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        assert_eq!(bench.set_real("in", 2.0).step().real("out"), 0.501);
    }

    #[test]
    fn null_gives_null_and_keeps_the_last_known_value() {
        let mut bench = PrimitiveHarness::new("RateLimit");
        bench.set_real("rate", 1.0).set_real("in", 1.0).step();
        assert!(bench.set_real("in", f64::NAN).step().real("out").is_nan());
        assert_eq!(bench.set_real("in", 2.0).step().real("out"), 1.001);
    }
}
