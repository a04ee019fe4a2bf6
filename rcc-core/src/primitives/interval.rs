//! `Interval`: whether a number is inside an interval, and its relative position in it.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, choose, each, finite, higher, lower,
    real_unless,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Interval",
        summary: "Whether a number is inside an interval, and its relative position from start to end.",
        undefined: "low not below high; overflow: an interval longer than the largest Real",
        formula: "fraction = (in - low) / (high - low), at least 0 and at most 1; inside = low ≤ in ≤ high",
        examples: &[Example::new(
            "from 10 to 20",
            "",
            "in | low | high | inside | fraction
             5 | 10 | 20 | false | 0
             10 | 10 | 20 | true | 0
             12.5 | 10 | 20 | true | 0.25
             20 | 10 | 20 | true | 1
             21 | 10 | 20 | false | 1
             12 | 20 | 10 | null | null
             null | 10 | 20 | null | null",
        )],
        inputs: &[
            Port::real("in", UnitRule::Var(0), "number to compare"),
            Port::real("low", UnitRule::Var(0), "start of the interval"),
            Port::real("high", UnitRule::Var(0), "end of the interval"),
        ],
        outputs: &[
            Port::bool(
                "inside",
                "the number is inside the interval, bounds included",
            )
            .diagnostic(),
            Port::real(
                "fraction",
                UnitRule::ONE,
                "relative position: 0 up to the start, 1 from the end on, linear in between",
            )
            .within(0.0, 1.0)
            .diagnostic(),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, low, high, inside, fraction]: [u32; 5]) -> Option<()> {
    let value = frame.get_real(input)?;
    let (low, high) = (frame.get_real(low)?, frame.get_real(high)?);
    let length = high - low;
    let known = !value.is_nan() & (length > 0.0) & length.is_finite();
    let is_inside = (low <= value) & (value <= high);
    let part = finite((lower(higher(value, low), high) - low) / length);
    frame.put_bool(inside, choose(known, u8::from(is_inside), NULL_BOOL))?;
    frame.put_real(fraction, real_unless(!known, part))
}
