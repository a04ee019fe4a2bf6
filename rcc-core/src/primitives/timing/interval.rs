//! `Interval`: whether a number is inside an interval, and its relative position in it.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, choose, finite,
    higher, lower, operands, real_unless,
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
    &[Kernel::each::<Interval>()],
);

operands! {
    struct Interval {
        input: Slot<Real>, low: Slot<Real>, high: Slot<Real>, inside: Slot<Bool>, fraction: Slot<Real>,
    }
}

impl Step for Interval {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        let length = high - low;
        let known = !value.is_nan() & (length > 0.0) & length.is_finite();
        let is_inside = (low <= value) & (value <= high);
        let part = finite((lower(higher(value, low), high) - low) / length);
        frame.put(self.inside, choose(known, u8::from(is_inside), NULL_BOOL))?;
        frame.put(self.fraction, real_unless(!known, part))
    }
}
