//! `Sine`: the sine of an angle, of any size.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Sine",
        summary: "The sine of an angle.",
        undefined: "overflow: an infinite angle",
        formula: "out = sin(in); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "special angles, and null",
            "",
            "in | out\n 0 | 0\n deg(30) | 0.5\n deg(-90) | -1\n deg(750) | 0.5\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::RADIAN, "angle")],
        outputs: &[Port::real("out", UnitRule::ONE, "its sine").within(-1.0, 1.0)],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::sin);
    })],
);
