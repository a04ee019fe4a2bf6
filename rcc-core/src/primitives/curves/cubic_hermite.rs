//! `CubicHermite`: a smooth curve given by value and slope at both ends.

use super::cubic_bezier::bezier;
use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, finite, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "CubicHermite",
        summary: "A number on a cubic curve with given values and slopes at both ends.",
        undefined: "overflow",
        formula: "the Bézier curve from, from + from_slope / 3, to - to_slope / 3, to (Farin, Curves and Surfaces for CAGD, \
                  5th ed., 6.5)",
        examples: &[Example::new(
            "zero slopes, and a given slope",
            "",
            "from | from_slope | to | to_slope | t | out
             0 | 0 | 1 | 0 | 0.25 | 0.15625
             0 | 0 | 1 | 0 | 0.5 | 0.5
             0 | 1 | 1 | 1 | 0.3 | 0.3
             1 | 4 | 1 | -4 | 0.5 | 2
             1 | 4 | 1 | -4 | 1 | 1
             1 | null | 1 | 0 | 0 | null",
        )],
        inputs: &[
            Port::real("from", UnitRule::Var(0), "result at t = 0"),
            Port::real(
                "from_slope",
                UnitRule::Var(0),
                "slope of the result by t at t = 0",
            ),
            Port::real("to", UnitRule::Var(0), "result at t = 1"),
            Port::real(
                "to_slope",
                UnitRule::Var(0),
                "slope of the result by t at t = 1",
            ),
            Port::real(
                "t",
                UnitRule::ONE,
                "curve parameter, 0 to 1; outside, the curve is extrapolated",
            ),
        ],
        outputs: &[Port::real("out", UnitRule::Var(0), "number on the curve")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<CubicHermite>()],
);

operands! {
    struct CubicHermite {
        from: Slot<Real>, from_slope: Slot<Real>, to: Slot<Real>, to_slope: Slot<Real>, t: Slot<Real>,
        out: Slot<Real>,
    }
}

impl Step for CubicHermite {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (from, from_slope) = (frame.get(self.from)?, frame.get(self.from_slope)?);
        let (to, to_slope) = (frame.get(self.to)?, frame.get(self.to_slope)?);
        let points = [from, from + from_slope / 3.0, to - to_slope / 3.0, to];
        let t = frame.get(self.t)?;
        frame.put(self.out, finite(bezier(points, t)))
    }
}
