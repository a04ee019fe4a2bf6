//! `ArcTangent`: the angle of a point in the plane, or, without `x`, the angle with a given tangent.

use core::f64::consts::PI;

use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Port, Spec, UnitRule, each_finite,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ArcTangent",
        summary: "The angle from the x axis to a point; with x = 1 the angle whose tangent is y.",
        undefined: "overflow: an infinite point",
        formula: "out = atan2(y, x), 0 for y = x = 0 (IEEE 754-2019, 9.2); libm (after FreeBSD msun): an error below 1 \
                  unit in the last place",
        examples: &[
            Example::new(
                "all quadrants",
                "",
                "y | x | out
                 0.0 | 2.0 | deg(0)
                 1.0 | 1.0 | deg(45)
                 1.0 | 0.0 | deg(90)
                 0.0 | -1.0 | deg(180)
                 -1.0 | -1.0 | deg(-135)
                 0.0 | 0.0 | deg(0)
                 null | 1.0 | null",
            ),
            Example::new(
                "angle of a tangent",
                "",
                "y | out
                 1 | deg(45)
                 -1 | deg(-45)
                 null | null",
            ),
        ],
        inputs: &[
            Port::real("y", UnitRule::Var(0), "y of the point, or a tangent"),
            Port::real("x", UnitRule::Var(0), "x of the point").default(DefaultValue::Real(1.0)),
        ],
        outputs: &[Port::real("out", UnitRule::RADIAN, "angle").within(-PI, PI)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_finite(frame, operands, libm::atan2);
    })],
);
