//! `Wrap`: wraps an angle into one turn, from -180° (exclusive) to 180°.

use core::f64::consts::{PI, TAU};

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Wrap",
        summary: "An angle wrapped into one turn, above -180° up to 180°.",
        undefined: "overflow: an infinite angle",
        formula: "out = in - 2π · n with the integer n that brings it into (-π, π]; exact up to the rounding of 2π \
                  (error below |in| · 2^-53)",
        examples: &[Example::new(
            "the direction stays",
            "",
            "in | out
             0 | 0
             deg(180) | deg(180)
             deg(-180) | deg(180)
             deg(190) | deg(-170)
             deg(-190) | deg(170)
             deg(725) | deg(5)
             null | null",
        )],
        inputs: &[Port::real("in", UnitRule::RADIAN, "angle")],
        outputs: &[
            Port::real("out", UnitRule::RADIAN, "angle in the same direction").within(-PI, PI),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, wrapped)
    })],
);

/// Returns the equivalent angle in (-π, π], rad.
#[inline(always)]
pub fn wrapped(angle: f64) -> f64 {
    // Exact, in (-2π, 2π); the subtraction of 2π, which is at most as large, is exact too.
    let rest = libm::fmod(angle, TAU);
    if rest > PI {
        rest - TAU
    } else if rest <= -PI {
        rest + TAU
    } else {
        rest
    }
}
