//! `ArcSine`: the angle with a given sine, between the right angles.

use core::f64::consts::FRAC_PI_2;

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ArcSine",
        summary: "The angle whose sine is given.",
        undefined: "in < -1; in > 1",
        formula: "out = arcsin(in); libm (after FreeBSD msun): an error below 1 unit in the last place",
        examples: &[Example::new(
            "from -1 to 1, and not beyond",
            "",
            "in | out\n 0.5 | deg(30)\n -1 | deg(-90)\n 1.1 | null\n null | null",
        )],
        inputs: &[Port::real(
            "in",
            UnitRule::ONE,
            "sine, from -1 to 1; what rounding put beyond, a `Limit` brings back",
        )],
        outputs: &[Port::real("out", UnitRule::RADIAN, "angle").within(-FRAC_PI_2, FRAC_PI_2)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::asin);
    })],
);
