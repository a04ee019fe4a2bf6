//! `CubicBezier`: a smooth curve given by its end points and two control points.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Slot, Spec, Step, UnitRule, finite, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "CubicBezier",
        summary: "A number on a cubic Bézier curve.",
        undefined: "overflow",
        formula: "out = (1-t)³ from + 3 (1-t)² t control1 + 3 (1-t) t² control2 + t³ to (Farin, Curves and \
                  Surfaces for CAGD, 5th ed., 4.3)",
        examples: &[Example::new(
            "ends, middle, and extrapolation",
            "",
            "from | control1 | control2 | to | t | out
             0 | 0 | 1 | 1 | 0 | 0
             0 | 0 | 1 | 1 | 0.25 | 0.15625
             0 | 0 | 1 | 1 | 0.5 | 0.5
             2 | 5 | 7 | 3 | 0.5 | 5.125
             2 | 5 | 7 | 3 | 1 | 3
             0 | 0 | 0 | 1 | 2 | 8
             0 | null | 1 | 1 | 0 | null",
        )],
        inputs: &[
            Port::real("from", UnitRule::Var(0), "result at t = 0"),
            Port::real("control1", UnitRule::Var(0), "control point of the start"),
            Port::real("control2", UnitRule::Var(0), "control point of the end"),
            Port::real("to", UnitRule::Var(0), "result at t = 1"),
            Port::real(
                "t",
                UnitRule::ONE,
                "curve parameter, 0 to 1; outside, the curve is extrapolated",
            ),
        ],
        outputs: &[Port::real("out", UnitRule::Var(0), "number on the curve")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<CubicBezier>()],
);

operands! {
    struct CubicBezier {
        from: Slot<Real>, control1: Slot<Real>, control2: Slot<Real>, to: Slot<Real>, t: Slot<Real>,
        out: Slot<Real>,
    }
}

impl Step for CubicBezier {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let CubicBezier {
            from,
            control1,
            control2,
            to,
            ..
        } = self;
        let points = [from, control1, control2, to].map(|slot| frame.get(slot));
        let [Some(a), Some(b), Some(c), Some(d)] = points else {
            return None;
        };
        let t = frame.get(self.t)?;
        frame.put(self.out, finite(bezier([a, b, c, d], t)))
    }
}

/// Returns the point of the curve at `t`.
#[inline(always)]
pub fn bezier([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    let u = 1.0 - t;
    u * u * (u * a + 3.0 * t * b) + t * t * (3.0 * u * c + t * d)
}
