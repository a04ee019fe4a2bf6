//! `Lookup`: a table of points with linear interpolation.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Dim, ElementType, Example, Kernel, Parameter,
    ParameterKind, Port, PortType, Real, Slot, Spec, Step, UnitRule, operands, real_unless,
};
use crate::types::Type;

const TABLE: PortType = PortType::Array(ElementType::Are(Type::Real), Dim::Var(0));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Lookup",
        summary: "Looks a number up in a table of points, with linear interpolation.",
        undefined: "overflow",
        formula: "y[i] + (in - x[i])·(y[i+1] - y[i]) / (x[i+1] - x[i]) with x[i] ≤ in ≤ x[i+1], found by bisection",
        inputs: &[Port::real("in", UnitRule::Var(0), "x value to look up")],
        outputs: &[Port::real("out", UnitRule::Var(1), "interpolated y value")],
        parameters: &[
            Parameter::new(
                "x",
                ParameterKind::Value(TABLE, UnitRule::Var(0)),
                "x of the points, increasing, at most 1024",
            )
            .rising(),
            Parameter::new(
                "y",
                ParameterKind::Value(TABLE, UnitRule::Var(1)),
                "y of the points",
            ),
            Parameter::new(
                "extrapolate",
                ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
                "true: the first and the last segment are extrapolated; false: the first and the last value hold",
            )
            .default(DefaultValue::Bool(false)),
        ],
        examples: &[
            Example::new(
                "three points, constant outside",
                "{x: [0.0, 1.0, 3.0], y: [10.0, 20.0, 0.0]}",
                "in | out
                 -1.0 | 10.0
                 0.0 | 10.0
                 0.5 | 15.0
                 1.0 | 20.0
                 2.0 | 10.0
                 4.0 | 0.0
                 null | null",
            ),
            Example::new(
                "extrapolated outside",
                "{x: [0.0, 1.0, 3.0], y: [10.0, 20.0, 0.0], extrapolate: true}",
                "in | out
                 -1.0 | 0.0
                 4.0 | -10.0",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Lookup>()],
);

operands! {
    struct Lookup {
        input: Slot<Real>, out: Slot<Real>, x: Slot<Real>, y: Slot<Real>, extrapolate: Slot<Bool>, length: u32,
    }
}

impl Step for Lookup {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Lookup { length, .. } = self;
        let at = frame.get(self.input)?;
        let extrapolate = frame.get(self.extrapolate)? == 1;
        if length < 2 {
            let only = frame.get(self.y)?;
            return frame.put(self.out, real_unless(at.is_nan(), only));
        }
        let (mut low, mut high) = (0, length - 1);
        // Bisection: at most one step for each bit of the length.
        for _ in 0..u32::BITS {
            if high - low < 2 {
                break;
            }
            let middle = low + (high - low) / 2;
            if frame.get(self.x + middle)? <= at {
                low = middle;
            } else {
                high = middle;
            }
        }
        let (x0, x1) = (frame.get(self.x + low)?, frame.get(self.x + high)?);
        let (y0, y1) = (frame.get(self.y + low)?, frame.get(self.y + high)?);
        let line = y0 + (at - x0) * (y1 - y0) / (x1 - x0);
        let held = match extrapolate {
            false if at <= x0 => y0,
            false if at >= x1 => y1,
            _ => line,
        };
        let null = at.is_nan() || x1 <= x0;
        frame.put(self.out, real_unless(null, held))
    }
}
