//! `Tare`: makes the current value, averaged over a time, the new zero, like the tare button of a scale.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, MemorySpec, Parameter, ParameterKind, Port,
    PortType, Spec, StateSpec, UnitRule, each, finite, reached,
};
use crate::types::Store;

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
    &[Kernel::of(Store::Real, |frame, operands| {
        each(frame, operands, step);
    })],
);

fn step(frame: &mut Frame<'_>, operands: [u32; 12]) -> Option<()> {
    let [
        input,
        trigger,
        out,
        zero_out,
        busy,
        refused,
        time,
        limit,
        bools,
        count,
        memory,
        width,
    ] = operands;
    let (zero, sum) = (memory, memory.saturating_add(width));
    let (now, before) = (frame.get_bool(trigger)?, frame.get_bool(bools)?);
    let begins = (now == 1) & (before != 1);
    let mut known = true;
    for i in 0..width {
        if begins {
            frame.put_real(sum + i, 0.0)?;
        }
        known &= frame.get_real(input + i)?.is_finite();
    }
    let averaged = if begins { 1 } else { frame.get_int(count)? };
    let mut next = averaged;
    let mut beyond = !begins & (frame.get_bool(bools + 1)? == 1);
    if (averaged > 0) & known {
        for i in 0..width {
            let value = frame.get_real(sum + i)? + frame.get_real(input + i)?;
            frame.put_real(sum + i, value)?;
        }
        next = averaged.saturating_add(1);
        if reached(averaged, frame.dt_s, frame.get_real(time)?) {
            next = 0;
            beyond = !take(frame, [sum, limit, zero, width], averaged as f64)?;
        }
    }
    for i in 0..width {
        let at = frame.get_real(zero + i)?;
        let relative = finite(frame.get_real(input + i)? - at);
        frame.put_real(zero_out + i, at)?;
        frame.put_real(out + i, relative)?;
    }
    frame.put_int(count, next)?;
    frame.put_bool(bools, now)?;
    frame.put_bool(bools + 1, u8::from(beyond))?;
    frame.put_bool(busy, u8::from(next > 0))?;
    frame.put_bool(refused, u8::from(beyond))
}

/// Makes the mean the zero unless an element exceeds the limit or is not finite; returns whether it did.
fn take(frame: &mut Frame<'_>, [sum, limit, zero, width]: [u32; 4], count: f64) -> Option<bool> {
    for i in 0..width {
        let (mean, most) = (frame.get_real(sum + i)? / count, frame.get_real(limit + i)?);
        // A null limit does not limit.
        if !mean.is_finite() || mean.abs() > most {
            return Some(false);
        }
    }
    for i in 0..width {
        let mean = frame.get_real(sum + i)? / count;
        frame.put_real(zero + i, mean)?;
    }
    Some(true)
}
