//! `Lerp`: linear interpolation between two numbers, and extrapolation beyond them.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, finite, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Lerp",
        summary: "A number interpolated linearly between two others; beyond 0 and 1 it is extrapolated.",
        undefined: "overflow",
        formula: "out = from + t · (to - from); exactly `to` for t = 1",
        examples: &[Example::new(
            "from 10 to 20",
            "",
            "from | to | t | out
             10 | 20 | 0 | 10
             10 | 20 | 0.25 | 12.5
             10 | 20 | 1 | 20
             10 | 20 | -1 | 0
             10 | null | 0 | null",
        )],
        inputs: &[
            Port::real("from", UnitRule::Var(0), "result at t = 0"),
            Port::real("to", UnitRule::Var(0), "result at t = 1"),
            Port::real("t", UnitRule::ONE, "interpolation parameter"),
        ],
        outputs: &[Port::real("out", UnitRule::Var(0), "interpolated number")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Lerp>()],
);

operands! {
    struct Lerp { from: Slot<Real>, to: Slot<Real>, t: Slot<Real>, out: Slot<Real> }
}

impl Step for Lerp {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (from, to) = (frame.get(self.from)?, frame.get(self.to)?);
        let t = frame.get(self.t)?;
        // Computed from the nearer end, which makes both ends exact.
        let value = if t < 0.5 {
            from + t * (to - from)
        } else {
            to - (1.0 - t) * (to - from)
        };
        frame.put(self.out, finite(value))
    }
}
