//! `AngleBetween`: the unsigned angle between two directions.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;
use crate::vector;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AngleBetween",
        summary: "The angle between two vectors of any length.",
        undefined: "a zero vector; overflow: an infinite input",
        formula: "2 atan2(|a - b|, |a + b|) of the directions (Kahan, How Futile are Mindless Assessments of Roundoff, 2006)",
        examples: &[Example::new(
            "perpendicular, parallel, opposite and oblique (numpy)",
            "",
            "a | b | out\n\
             [1, 0, 0] | [0, 5, 0] | deg(90)\n\
             [1, 1, 0] | [2, 2, 0] | 0\n\
             [1, 0, 0] | [-3, 0, 0] | deg(180)\n\
             [1, 2, 3] | [-2, 1, 0.5] | 1.3949275767021716\n\
             [0, 0, 0] | [1, 0, 0] | null",
        )],
        inputs: &[
            Port::new(
                "a",
                PortType::Is(Type::Vector3),
                UnitRule::Var(0),
                "first vector, not zero",
            ),
            Port::new(
                "b",
                PortType::Is(Type::Vector3),
                UnitRule::Var(1),
                "second vector, not zero, same axes",
            ),
        ],
        outputs: &[Port::real("out", UnitRule::Is(Unit::RADIAN), "angle")
            .within(0.0, core::f64::consts::PI)],
        ..Spec::PLAIN
    },
    &[Kernel::each::<AngleBetween>()],
);

operands! {
    struct AngleBetween { a: Slot<Vector3>, b: Slot<Vector3>, out: Slot<Real> }
}

impl Step for AngleBetween {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let direction = |slot| frame.composite(slot).and_then(vector::normalized);
        let angle = direction(self.a).zip(direction(self.b)).map(|(a, b)| {
            let (apart, together) = (vector::subtract(a, b), vector::add(a, b));
            2.0 * libm::atan2(vector::norm(apart), vector::norm(together))
        });
        frame.put(self.out, angle.unwrap_or(NULL_REAL))
    }
}
