//! `Tangent`: the tangent of an angle; defined for every finite angle, because no Real is exactly π/2.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Tangent",
        summary: "The tangent of an angle.",
        undefined: "overflow: an infinite angle",
        formula: "out = tan(in); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "±45°",
            "",
            "in | out\n 0 | 0\n deg(45) | 1\n deg(-45) | -1\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::RADIAN, "angle")],
        outputs: &[Port::real("out", UnitRule::ONE, "tangent")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::tan);
    })],
);
