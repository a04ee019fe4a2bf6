//! `ArcCosine`: the angle with a given cosine, 0 to π.

use core::f64::consts::PI;

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ArcCosine",
        summary: "The angle with a given cosine.",
        undefined: "in < -1; in > 1",
        formula: "out = arccos(in); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "within -1 to 1, and outside",
            "",
            "in | out\n 0.5 | deg(60)\n -1 | deg(180)\n 1 | deg(0)\n -1.1 | null\n null | null",
        )],
        inputs: &[Port::real(
            "in",
            UnitRule::ONE,
            "cosine, from -1 to 1; use `Limit` to remove an excess caused by rounding",
        )],
        outputs: &[Port::real("out", UnitRule::RADIAN, "angle").within(0.0, PI)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::acos);
    })],
);
