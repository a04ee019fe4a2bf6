//! `WindowMean`: the mean of the last values, at the same cost whatever the window is.

use crate::frame::Frame;
use crate::primitive::{
    Entry, Example, Kernel, Memory, Parameter, ParameterKind, Port, Spec, State, UnitRule, each,
    finite,
};
use crate::types::{NULL_REAL, Store};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "WindowMean",
        summary: "The mean of the values of a window of time; until it is full, of those that there are.",
        null: "a null input gives null and is not counted",
        undefined: "overflow: a sum too large for a number",
        formula: "sum of the last n values / n with a running sum, which is begun anew with every n values, so that its \
                  rounding is that of at most 2 n additions",
        examples: &[Example::new(
            "three values",
            "{window: 3 ms}",
            "in | out
             3 | 3
             6 | 4.5
             0 | 3
             null | null
             3 | 3
             9 | 4",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "value to average")],
        outputs: &[Port::real("out", UnitRule::Var(0), "mean")],
        parameters: &[Parameter::new(
            "window",
            ParameterKind::Window,
            "how far back it looks, the nearest whole number of evaluations",
        )],
        // the sum of the window, the sum since its ring began anew
        // the place of the next value in the ring, the number of values
        state: State {
            reals: 2,
            ints: 2,
            ..State::NONE
        },
        memory: Memory::window(1).of(Store::Real),
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out, sums, counts, ring, cycles]: [u32; 6]) -> Option<()> {
    let value = frame.get_real(input)?;
    if !value.is_finite() {
        return frame.put_real(out, NULL_REAL);
    }
    let length = i64::from(cycles.max(1));
    let within = |count: i64, most: i64| {
        if (0..=most).contains(&count) {
            count
        } else {
            0
        }
    };
    let place = within(frame.get_int(counts)?, length - 1);
    let count = within(frame.get_int(counts + 1)?, length);
    // At most CYCLES_MAX.
    let slot = ring + place as u32;
    let oldest = if count == length {
        frame.get_real(slot)?
    } else {
        0.0
    };
    let sum = if count == 0 {
        0.0
    } else {
        frame.get_real(sums)?
    };
    let since = if place == 0 {
        0.0
    } else {
        frame.get_real(sums + 1)?
    } + value;
    let is_last = place == length - 1;
    let sum = if is_last { since } else { sum - oldest + value };
    let count = (count + 1).min(length);
    frame.put_real(slot, value)?;
    frame.put_real(sums, sum)?;
    frame.put_real(sums + 1, since)?;
    frame.put_int(counts, if is_last { 0 } else { place + 1 })?;
    frame.put_int(counts + 1, count)?;
    frame.put_real(out, finite(sum / count as f64))
}
