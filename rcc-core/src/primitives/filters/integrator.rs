//! `Integrator`: integrates a rate over time, with limits that also stop the integral (no windup).

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, PortType,
    Real, Slot, Spec, StateSpec, Step, UnitRule, finite, operands, within,
};
use crate::types::{NULL_BOOL, Type};

const BOUND: ParameterKind = ParameterKind::Value(PortType::Is(Type::Real), UnitRule::Var(0));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Integrator",
        summary: "Integrates a rate over time; with a rate of 1 it is a stopwatch.",
        null: "a null input gives null and holds the state",
        undefined: "low above high; overflow",
        formula: "out += in · dt (backward Euler: the rate of this cycle applies to the period that ends with it), then limited; limiting the integral is clamping anti-windup (Åström and Hägglund, Advanced PID Control, 2006, 3.5)",
        examples: &[
            Example::new(
                "a rate of 2 per second every 0.1 s",
                "{initial: 1}",
                "in | reset | out
                 2 | false | 1.2
                 2 | false | 1.4
                 null | false | null
                 -1 | false | 1.3
                 5 | true | 1
                 5 | false | 1.5",
            )
            .every_ms(100),
            Example::new(
                "a limit is left at once",
                "{low: -1, high: 1}",
                "in | out\n 800 | 0.8\n 800 | 1\n 800 | 1\n -300 | 0.7",
            ),
        ],
        inputs: &[
            Port::real("in", UnitRule::PerSecond(0), "rate"),
            Port::bool("reset", "while true, the output is `initial`")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[Port::real("out", UnitRule::Var(0), "integral")],
        parameters: &[
            Parameter::new(
                "initial",
                BOUND,
                "value before the first cycle and after a reset",
            )
            .default(DefaultValue::Real(0.0)),
            Parameter::new("low", BOUND, "minimum output; null: no limit")
                .default(DefaultValue::Null),
            Parameter::new("high", BOUND, "maximum output; null: no limit")
                .default(DefaultValue::Null),
        ],
        state: StateSpec {
            reals: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Integrator>()],
);

operands! {
    struct Integrator {
        input: Slot<Real>, reset: Slot<Bool>, out: Slot<Real>, initial: Slot<Real>, low: Slot<Real>,
        high: Slot<Real>, sum: Slot<Real>,
    }
}

impl Step for Integrator {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (rate, reset) = (frame.get(self.input)?, frame.get(self.reset)?);
        let (initial, before) = (frame.get(self.initial)?, frame.get(self.sum)?);
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        let from = if before.is_nan() { initial } else { before };
        let moved = from + rate * frame.dt_s;
        let null = rate.is_nan() | (reset & NULL_BOOL != 0);
        let now = within(if reset == 1 { initial } else { moved }, low, high);
        let known = !null & now.is_finite();
        frame.put(self.out, finite(if known { now } else { f64::NAN }))?;
        frame.put(self.sum, if known { now } else { before })
    }
}
