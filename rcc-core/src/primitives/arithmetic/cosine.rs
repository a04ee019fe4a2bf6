//! `Cosine`: the cosine of an angle, of any size.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Cosine",
        summary: "The cosine of an angle.",
        undefined: "overflow: an infinite angle",
        formula: "out = cos(in); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "special angles, and null",
            "",
            "in | out\n 0 | 1\n deg(60) | 0.5\n deg(-90) | 0\n deg(180) | -1\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::RADIAN, "angle")],
        outputs: &[Port::real("out", UnitRule::ONE, "cosine").within(-1.0, 1.0)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::cos);
    })],
);
