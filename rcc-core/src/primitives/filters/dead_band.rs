//! `DeadBand`: suppresses small deviations: 0 within a band, the distance from the band outside.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, finite, operands,
    real_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DeadBand",
        summary: "0 within a band, and the distance from the band outside it, without a step at its edges.",
        undefined: "low above high; overflow",
        formula: "out = in - high above high, in - low below low, else 0 (Dead Zone of Simulink)",
        examples: &[Example::new(
            "a band from -1 to 2",
            "",
            "in | low | high | out
             0.5 | -1 | 2 | 0
             2 | -1 | 2 | 0
             2.5 | -1 | 2 | 0.5
             -3 | -1 | 2 | -2
             0 | 2 | -1 | null
             null | -1 | 2 | null",
        )],
        inputs: &[
            Port::real("in", UnitRule::Var(0), "number"),
            Port::real("low", UnitRule::Var(0), "lower edge of the band"),
            Port::real("high", UnitRule::Var(0), "upper edge of the band"),
        ],
        outputs: &[Port::real(
            "out",
            UnitRule::Var(0),
            "distance from the band, with its sign",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<DeadBand>()],
);

operands! {
    struct DeadBand { input: Slot<Real>, low: Slot<Real>, high: Slot<Real>, out: Slot<Real> }
}

impl Step for DeadBand {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        let (low, high) = (frame.get(self.low)?, frame.get(self.high)?);
        let beyond = if value > high {
            value - high
        } else if value < low {
            value - low
        } else {
            0.0
        };
        let known = !value.is_nan() & (low <= high);
        frame.put(self.out, real_unless(!known, finite(beyond)))
    }
}
