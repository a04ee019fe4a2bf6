//! `Unwrap`: makes an angle that jumps by full turns continuous: the inverse of `Wrap` for signals.

use core::f64::consts::TAU;

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Int, Kernel, Port, Real, Slot, Spec, StateSpec, Step, UnitRule,
    finite, operands, real_unless, whole,
};
use crate::types::NULL_INT;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Unwrap",
        summary: "An angle without jumps by full turns: from cycle to cycle it takes the shorter way.",
        null: "a null input gives null and holds the state: the next angle takes the shorter way from the last known one",
        undefined: "overflow: more than 2^63 turns",
        formula: "out = in + 2π · n; n changes by the number of turns nearest to the step of `in`",
        examples: &[Example::new(
            "over 180° and back; null is bridged",
            "",
            "in | out
             deg(170) | deg(170)
             deg(-170) | deg(190)
             deg(-10) | deg(350)
             null | null
             deg(100) | deg(460)
             deg(-10) | deg(350)
             deg(170) | deg(170)",
        )],
        inputs: &[Port::real(
            "in",
            UnitRule::RADIAN,
            "angle, e.g. within one turn",
        )],
        outputs: &[Port::real(
            "out",
            UnitRule::RADIAN,
            "continuous angle; starts at the first input",
        )],
        state: StateSpec {
            reals: 1,
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Unwrap>()],
);

operands! {
    struct Unwrap { input: Slot<Real>, out: Slot<Real>, last: Slot<Real>, turns: Slot<Int> }
}

impl Step for Unwrap {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (angle, before) = (frame.get(self.input)?, frame.get(self.last)?);
        // At the start the step is NaN, and no turn is added.
        let step = whole(libm::round((angle - before) / TAU));
        let change = if step == NULL_INT { 0 } else { step };
        let count = frame.get(self.turns)?.saturating_sub(change);
        let known = angle.is_finite();
        frame.put(
            self.out,
            real_unless(!known, finite(angle + TAU * count as f64)),
        )?;
        if known {
            frame.put(self.last, angle)?;
            frame.put(self.turns, count)?;
        }
        Some(())
    }
}
