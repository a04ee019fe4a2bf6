//! `PID`: a proportional, integral and derivative controller in the standard (ISA) form, with filtered derivative of
//! the measurement, set-point weight, output limits, anti-windup by back-calculation, and bumpless manual mode.
//!
//! Everything is discretised by backward differences except the integral, which is a forward difference: its increment
//! takes effect in the next cycle, when the limits of the output are known.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, PortType,
    Real, Slot, Spec, StateSpec, Step, UnitRule, choose, finite, operands, within,
};
use crate::types::{NULL_BOOL, NULL_REAL, Type};

const OUTPUT: ParameterKind = ParameterKind::Value(PortType::Is(Type::Real), UnitRule::Var(1));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "PID",
        summary: "A PID controller with output limits, anti-windup and manual mode.",
        null: "a null input gives null, holds the integral and resets the derivative",
        undefined: "low above high; overflow",
        formula: "out = limit(P + I + D + feed_forward); P = gain (weight setpoint - measured); I += gain dt / integral_time \
                  (setpoint - measured) + dt / tracking_time (out - unlimited out); D = (Td D - gain Td N Δmeasured) / (Td \
                  + N dt), Td = derivative_time, N = derivative_gain (Åström and Hägglund, Advanced PID Control, 2006, \
                  3.4, 3.5 and 13.3)",
        examples: &[
            Example::new(
                "proportional: half of the control error",
                "{gain: 0.5}",
                "setpoint | measured | out\n 4 | 0 | 2\n 4 | 3 | 0.5\n 4 | null | null\n 4 | 5 | -0.5",
            ),
            Example::new(
                "the integral grows by gain · dt / integral_time · error, from the second cycle on",
                "{gain: 2, integral_time: 1 s}",
                "setpoint | measured | out\n 1 | 0 | 2\n 1 | 0 | 2.2\n 1 | 0 | 2.4\n 1 | 1 | 0.6\n 1 | 1 | 0.6",
            )
            .every_ms(100),
            Example::new(
                "at the limit the integral tracks the output instead of growing, so that it leaves the limit at once",
                "{gain: 2, integral_time: 1 s, tracking_time: 0.1 s, high: 1}",
                "setpoint | measured | out | saturated
                 1 | 0 | 1 | true
                 1 | 0 | 1 | true
                 1 | 0 | 1 | true
                 1 | 1 | -0.8 | false",
            )
            .every_ms(100),
            Example::new(
                "the derivative acts on the measurement: a step of the set-point causes no kick",
                "{gain: 1, derivative_time: 0.1 s, derivative_gain: 1}",
                "setpoint | measured | out\n 0 | 0 | 0\n 1 | 0 | 1\n 1 | 0.2 | 0.7\n 1 | 0.2 | 0.75",
            )
            .every_ms(100),
            Example::new(
                "from manual to automatic without a bump",
                "{gain: 2, integral_time: 1 s}",
                "setpoint | measured | manual | manual_value | out
                 1 | 0.5 | true | 7 | 7
                 1 | 0.5 | false | 7 | 7
                 1 | 0.5 | false | 7 | 7.1",
            )
            .every_ms(100),
        ],
        inputs: &[
            Port::real("setpoint", UnitRule::Var(0), "set-point"),
            Port::real("measured", UnitRule::Var(0), "what is"),
            Port::real("feed_forward", UnitRule::Var(1), "feed-forward, added to the output")
                .default(DefaultValue::Real(0.0)),
            Port::bool("manual", "while true, the output is `manual_value` and the integral tracks it")
                .default(DefaultValue::Bool(false)),
            Port::real("manual_value", UnitRule::Var(1), "output in manual mode").default(DefaultValue::Real(0.0)),
        ],
        outputs: &[
            Port::real("out", UnitRule::Var(1), "controller output"),
            Port::bool("saturated", "the output is limited").diagnostic(),
            Port::real("integral", UnitRule::Var(1), "integral term I used in this cycle").diagnostic(),
        ],
        parameters: &[
            Parameter::real("gain", UnitRule::Quotient(1, 0), "gain K; negative if more output decreases the measurement"),
            Parameter::real("integral_time", UnitRule::SECOND, "integral time Ti, in which the integral repeats the proportional action; null: no integral")
                .default(DefaultValue::Null)
                .above(0.0),
            Parameter::real("derivative_time", UnitRule::SECOND, "derivative time Td, the prediction horizon of the derivative; 0: no derivative")
                .default(DefaultValue::Real(0.0))
                .at_least(0.0),
            Parameter::real("derivative_gain", UnitRule::ONE, "N: the derivative's filter has the time constant Td / N")
                .default(DefaultValue::Real(10.0))
                .above(0.0),
            Parameter::real("weight", UnitRule::ONE, "set-point weight b of the proportional part; lower values overshoot less")
                .default(DefaultValue::Real(1.0))
                .at_least(0.0),
            Parameter::real(
                "tracking_time",
                UnitRule::SECOND,
                "tracking time Tt, in which the integral follows a limited output; null: √(Ti Td), or Ti without derivative",
            )
            .default(DefaultValue::Null)
            .above(0.0),
            Parameter::new("low", OUTPUT, "minimum output; null: no limit").default(DefaultValue::Null),
            Parameter::new("high", OUTPUT, "maximum output; null: no limit").default(DefaultValue::Null),
        ],
        state: StateSpec {
            reals: 3,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Pid>()],
);

operands! {
    struct Pid {
        setpoint: Slot<Real>, measured: Slot<Real>, feed_forward: Slot<Real>, manual: Slot<Bool>,
        manual_value: Slot<Real>, out: Slot<Real>, saturated: Slot<Bool>, integral: Slot<Real>,
        gain: Slot<Real>, integral_time: Slot<Real>, derivative_time: Slot<Real>, derivative_gain: Slot<Real>,
        weight: Slot<Real>, tracking_time: Slot<Real>, low: Slot<Real>, high: Slot<Real>,
        /// Integral, derivative, last measurement.
        state: Slot<[Real; 3]>,
    }
}

impl Step for Pid {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (setpoint, measured) = (frame.get(self.setpoint)?, frame.get(self.measured)?);
        let (feed_forward, manual) = (frame.get(self.feed_forward)?, frame.get(self.manual)?);
        let manual_value = frame.get(self.manual_value)?;
        let law = PidParameters {
            gain: frame.get(self.gain)?,
            integral_time: frame.get(self.integral_time)?,
            derivative_time: frame.get(self.derivative_time)?,
            derivative_gain: frame.get(self.derivative_gain)?,
            tracking_time: frame.get(self.tracking_time)?,
            dt_s: frame.dt_s,
        };
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        let [sum, rate, last] = frame.get(self.state)?;
        let sum = if sum.is_nan() { 0.0 } else { sum };
        let derivative = finite(law.derivative(rate, measured - last));
        let proportional = law.gain * (frame.get(self.weight)? * setpoint - measured);
        let others = proportional + derivative + feed_forward;
        let is_manual = manual == 1;
        let followed = law.follows(is_manual, within(manual_value, low, high) - others, sum);
        let unlimited = if is_manual {
            manual_value
        } else {
            others + followed
        };
        let limited = finite(within(unlimited, low, high));
        // Any null input makes it NaN, except a manual value that is not used.
        let null =
            limited.is_nan() | (manual & NULL_BOOL != 0) | manual_value.is_nan() | others.is_nan();
        let next = if is_manual {
            followed
        } else {
            followed + law.growth(setpoint - measured, limited - unlimited)
        };
        frame.put(self.out, if null { NULL_REAL } else { limited })?;
        frame.put(
            self.saturated,
            choose(null, NULL_BOOL, u8::from(limited != unlimited)),
        )?;
        frame.put(
            self.integral,
            if null { NULL_REAL } else { finite(followed) },
        )?;
        let held = null | !next.is_finite();
        let remembered = if null {
            [sum, 0.0, NULL_REAL]
        } else {
            [if held { sum } else { next }, derivative, measured]
        };
        frame.put(self.state, remembered)
    }
}

/// The parameters; times in s.
struct PidParameters {
    gain: f64,
    integral_time: f64,
    derivative_time: f64,
    derivative_gain: f64,
    tracking_time: f64,
    dt_s: f64,
}

impl PidParameters {
    /// Returns D after a change of the measurement; without a previous measurement there is no change.
    fn derivative(&self, rate: f64, change: f64) -> f64 {
        let change = if change.is_nan() { 0.0 } else { change };
        let rate = if rate.is_nan() { 0.0 } else { rate };
        let moved = rate - self.gain * self.derivative_gain * change;
        self.derivative_time * moved / (self.derivative_time + self.derivative_gain * self.dt_s)
    }

    /// Returns I of this cycle: in manual mode the value that gives the manual output; always 0 without an integral.
    fn follows(&self, is_manual: bool, wanted: f64, sum: f64) -> f64 {
        if self.integral_time.is_nan() {
            0.0
        } else if is_manual {
            wanted
        } else {
            sum
        }
    }

    /// Returns the increment of the integral in this cycle: from the control error, and from the part of the output
    /// that the limits removed.
    fn growth(&self, error: f64, taken_off: f64) -> f64 {
        if self.integral_time.is_nan() {
            return 0.0;
        }
        let usual = if self.derivative_time > 0.0 {
            libm::sqrt(self.integral_time * self.derivative_time)
        } else {
            self.integral_time
        };
        let tracking = if self.tracking_time.is_nan() {
            usual
        } else {
            self.tracking_time
        };
        // Within one cycle it tracks at most completely.
        let followed = if tracking > self.dt_s {
            self.dt_s / tracking
        } else {
            1.0
        };
        self.gain * self.dt_s / self.integral_time * error + followed * taken_off
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    const DT_S: f64 = 1e-3;

    fn bench(parameters: &[(&str, f64)]) -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("PID");
        bench.set_bool("manual", Some(false));
        let usual = [
            ("feed_forward", 0.0),
            ("manual_value", 0.0),
            ("derivative_time", 0.0),
        ];
        let more = [("derivative_gain", 10.0), ("weight", 1.0)];
        for (name, value) in usual.iter().chain(&more).chain(parameters) {
            bench.set_real(name, *value);
        }
        bench
    }

    /// The plant 2 / (1 + 0.5 s)², exact for an input that is constant over a step.
    #[derive(Clone, Copy, Default)]
    struct Plant([f64; 2]);

    impl Plant {
        fn step(&mut self, input: f64, dt_s: f64) {
            let [a, b] = self.0;
            let (decay, x) = ((-dt_s / 0.5).exp(), dt_s / 0.5);
            let target = 2.0 * input;
            self.0 = [
                target + (a - target) * decay,
                target + (b - target + (a - target) * x) * decay,
            ];
        }

        fn output(&self) -> f64 {
            self.0[1]
        }
    }

    const PARAMETERS: [(&str, f64); 4] = [
        ("gain", 1.5),
        ("integral_time", 0.8),
        ("derivative_time", 0.15),
        ("weight", 0.7),
    ];

    #[test]
    fn the_step_response_is_that_of_the_continuous_controller() {
        let mut bench = bench(&PARAMETERS);
        let mut plant = Plant::default();
        // The same control law as differential equations, by Euler integration with steps a hundredth as long.
        const FINE: usize = 100;
        let fine_s = DT_S / FINE as f64;
        let (gain, ti, td, n, weight) = (1.5, 0.8, 0.15, 10.0, 0.7);
        let (mut integral, mut filtered, mut other) = (0.0, 0.0, Plant::default());
        for cycle in 0..8000 {
            bench.set_real("setpoint", 1.0);
            let out = bench
                .set_real("measured", plant.output())
                .step()
                .real("out");
            assert!(
                (plant.output() - other.output()).abs() < 2e-3,
                "cycle {cycle}: {}, not {}",
                plant.output(),
                other.output()
            );
            plant.step(out, DT_S);
            for _ in 0..FINE {
                let y = other.output();
                let slope = (y - filtered) * n / td;
                let derivative = -gain * td * slope;
                filtered += slope * fine_s;
                let input = gain * (weight - y) + integral + derivative;
                integral += gain / ti * (1.0 - y) * fine_s;
                other.step(input, fine_s);
            }
        }
        assert!((plant.output() - 1.0).abs() < 1e-4);
    }

    #[test]
    fn a_constant_disturbance_leaves_no_error() {
        let mut bench = bench(&PARAMETERS);
        let mut plant = Plant::default();
        for cycle in 0..40_000 {
            bench.set_real("setpoint", if cycle < 20_000 { 1.0 } else { -2.0 });
            let out = bench
                .set_real("measured", plant.output())
                .step()
                .real("out");
            plant.step(out + 0.8, DT_S);
        }
        assert!((plant.output() + 2.0).abs() < 1e-9, "{}", plant.output());
        assert_eq!(bench.bool("saturated"), Some(false));
    }

    /// Returns for how many cycles the output stays at its limit after the error has changed its sign, and the integral
    /// before.
    fn wound_up(tracking_time: f64) -> (usize, f64) {
        let mut bench = bench(&PARAMETERS);
        bench
            .set_real("low", -1.0)
            .set_real("high", 1.0)
            .set_real("tracking_time", tracking_time)
            .set_real("measured", 0.0);
        bench.set_real("setpoint", 3.0);
        for _ in 0..10_000 {
            assert_eq!(bench.step().real("out"), 1.0);
        }
        let integral = bench.real("integral");
        bench.set_real("setpoint", -0.1);
        let stays = (0..100_000).take_while(|_| bench.step().real("out") == 1.0);
        (stays.count(), integral)
    }

    #[test]
    fn the_integral_does_not_wind_up_at_a_limit() {
        let (cycles, integral) = wound_up(f64::NAN);
        assert!(cycles == 0, "{cycles}");
        // P is 1.5 · 0.7 · 3; the integral settles where its increment is zero: Ki e = (v - u) / Tt.
        let settled = 1.0 - 3.15 + 1.5 / 0.8 * 3.0 * f64::sqrt(0.8 * 0.15);
        assert!(
            (integral - settled).abs() < 1e-6,
            "{integral}, not {settled}"
        );
        let (cycles, _) = wound_up(1e9);
        assert!(
            cycles > 10_000,
            "without anti-windup it stays for long: {cycles}"
        );
    }

    #[test]
    fn a_null_is_not_remembered() {
        let mut bench = bench(&PARAMETERS);
        bench.set_real("setpoint", 1.0).set_real("measured", 0.2);
        for _ in 0..100 {
            bench.step();
        }
        let integral = bench.real("integral");
        for name in ["setpoint", "measured", "feed_forward", "manual_value"] {
            let before = bench.real(name);
            assert!(
                bench.set_real(name, f64::NAN).step().real("out").is_nan(),
                "{name}"
            );
            assert_eq!(bench.bool("saturated"), None, "{name}");
            bench.set_real(name, before);
        }
        assert!(bench.set_bool("manual", None).step().real("out").is_nan());
        bench.set_bool("manual", Some(false));
        // The measurement may have changed a lot meanwhile: this must not cause a kick.
        let out = bench.set_real("measured", 0.9).step().real("out");
        assert!((bench.real("integral") - integral).abs() < 2e-3);
        assert!((out - (1.5 * (0.7 - 0.9) + bench.real("integral"))).abs() < 1e-12);
    }

    #[test]
    fn the_output_recovers_from_an_overflow() {
        let mut bench = bench(&PARAMETERS);
        bench
            .set_real("setpoint", 1.0)
            .set_real("measured", 0.0)
            .step();
        for bad in [f64::INFINITY, 1e308, -1e308, f64::NEG_INFINITY] {
            bench.set_real("measured", bad).step();
            assert!(!bench.real("out").is_infinite());
            bench.set_real("measured", 0.0).step();
            assert!(bench.step().real("out").abs() < 10.0, "{bad}");
        }
    }
}
