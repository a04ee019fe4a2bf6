//! `ArcSine`: the angle with a given sine, -π/2 to π/2.

use core::f64::consts::FRAC_PI_2;

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ArcSine",
        summary: "The angle with a given sine.",
        undefined: "in < -1; in > 1",
        formula: "out = arcsin(in); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "within -1 to 1, and outside",
            "",
            "in | out\n 0.5 | deg(30)\n -1 | deg(-90)\n 1.1 | null\n null | null",
        )],
        inputs: &[Port::real(
            "in",
            UnitRule::ONE,
            "sine, from -1 to 1; use `Limit` to remove an excess caused by rounding",
        )],
        outputs: &[Port::real("out", UnitRule::RADIAN, "angle").within(-FRAC_PI_2, FRAC_PI_2)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::asin);
    })],
);
