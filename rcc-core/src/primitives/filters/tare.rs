//! `Tare`: makes the current value, averaged over a time, the new zero, like the tare button of a scale.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Int, Kernel, MemorySpec, Parameter, ParameterKind,
    Port, PortType, Real, Slot, Spec, StateSpec, Step, UnitRule, finite, operands, reached,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Tare",
        summary: "A number, vector or wrench relative to its mean over a time after `trigger` became true.",
        null: "a null element gives a null element; a cycle with one is not averaged, which prolongs `busy`; a null `trigger` starts nothing",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "out = in - zero; zero = mean of the n known values from the rising edge of `trigger` on, n · dt ≥ time; it takes effect in the cycle of the n-th value",
        examples: &[
            Example::new(
                "mean of two values; a trigger that stays true does not count again",
                "{time: 2 ms}",
                "in | trigger | out | zero | busy
                 4.0 | false | 4.0 | 0.0 | false
                 4.0 | true | 4.0 | 0.0 | true
                 null | true | null | 0.0 | true
                 2.0 | true | -1.0 | 3.0 | false
                 5.0 | true | 2.0 | 3.0 | false
                 5.0 | false | 2.0 | 3.0 | false
                 1.0 | true | -2.0 | 3.0 | true
                 1.0 | false | 0.0 | 1.0 | false",
            ),
            Example::new(
                "a zero that is too large is refused until the next trigger",
                "{time: 0, limit: 10.0}",
                "in | trigger | out | zero | refused
                 3.0 | true | 0.0 | 3.0 | false
                 12.0 | false | 9.0 | 3.0 | false
                 12.0 | true | 9.0 | 3.0 | true
                 9.0 | false | 6.0 | 3.0 | true
                 9.0 | true | 0.0 | 9.0 | false",
            ),
        ],
        inputs: &[
            Port::linear("in", UnitRule::Var(0), "value to tare"),
            Port::bool("trigger", "starts averaging when it becomes true, also in the first cycle")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::linear("out", UnitRule::Var(0), "value relative to the zero"),
            Port::linear("zero", UnitRule::Var(0), "the zero: 0 before the first trigger").diagnostic(),
            Port::bool("busy", "averaging; `out` still uses the previous zero").diagnostic(),
            Port::bool("refused", "the last mean exceeded `limit`, and the zero was kept").diagnostic(),
        ],
        parameters: &[
            Parameter::real("time", UnitRule::SECOND, "averaging time; 0: a single value")
                .at_least(0.0)
                .at_most(100.0),
            Parameter::new(
                "limit",
                ParameterKind::Value(PortType::Linear, UnitRule::Var(0)),
                "largest zero, per element; a larger one, e.g. a load, is refused; if omitted, unlimited",
            )
            .default(DefaultValue::Null),
        ],
        // last trigger, last mean was refused; 1 + number of values averaged so far, 0 while not averaging
        state: StateSpec {
            bools: 2,
            ints: 1,
            ..StateSpec::NONE
        },
        // zero, sum
        memory: MemorySpec::values(2).starting(DefaultValue::Real(0.0)),
        ..Spec::PLAIN
    },
    &[Kernel::each::<Tare>()],
);

operands! {
    struct Tare for Real {
        input: Slot<Real>, trigger: Slot<Bool>, out: Slot<Real>, zero: Slot<Real>, busy: Slot<Bool>,
        refused: Slot<Bool>, time: Slot<Real>, limit: Slot<Real>, bools: Slot<[Bool; 2]>, count: Slot<Int>,
        memory: Slot<Real>, width: u32,
    }
}

impl Step for Tare {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (zero, sum) = (self.memory, self.sum());
        let now = frame.get(self.trigger)?;
        let [before, was_beyond] = frame.get(self.bools)?;
        let begins = (now == 1) & (before != 1);
        let mut known = true;
        for i in 0..self.width {
            if begins {
                frame.put(sum + i, 0.0)?;
            }
            known &= frame.get(self.input + i)?.is_finite();
        }
        let averaged = if begins { 1 } else { frame.get(self.count)? };
        let mut next = averaged;
        let mut beyond = !begins & (was_beyond == 1);
        if (averaged > 0) & known {
            for i in 0..self.width {
                let value = frame.get(sum + i)? + frame.get(self.input + i)?;
                frame.put(sum + i, value)?;
            }
            next = averaged.saturating_add(1);
            if reached(averaged, frame.dt_s, frame.get(self.time)?) {
                next = 0;
                beyond = !self.take(frame, averaged as f64)?;
            }
        }
        for i in 0..self.width {
            let at = frame.get(zero + i)?;
            let relative = finite(frame.get(self.input + i)? - at);
            frame.put(self.zero + i, at)?;
            frame.put(self.out + i, relative)?;
        }
        frame.put(self.count, next)?;
        frame.put(self.bools, [now, u8::from(beyond)])?;
        frame.put(self.busy, u8::from(next > 0))?;
        frame.put(self.refused, u8::from(beyond))
    }
}

impl Tare {
    /// The sums follow the zeros in the memory.
    fn sum(self) -> Slot<Real> {
        self.memory + self.width
    }

    /// Makes the mean the zero unless an element exceeds the limit or is not finite; returns whether it did.
    fn take(self, frame: &mut Frame<'_>, count: f64) -> Option<bool> {
        for i in 0..self.width {
            let (mean, most) = (
                frame.get(self.sum() + i)? / count,
                frame.get(self.limit + i)?,
            );
            // A null limit does not limit.
            if !mean.is_finite() || mean.abs() > most {
                return Some(false);
            }
        }
        for i in 0..self.width {
            let mean = frame.get(self.sum() + i)? / count;
            frame.put(self.memory + i, mean)?;
        }
        Some(true)
    }
}
