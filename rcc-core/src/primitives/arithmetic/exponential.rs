//! `Exponential`: e to the power of a number.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Exponential",
        summary: "The exponential of a number.",
        undefined: "overflow: a number above 709.78",
        formula: "out = e^in; libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "powers of e, and an overflow",
            "",
            "in | out\n 0 | 1\n 1 | 2.718281828459045\n -1 | 0.36787944117144233\n 710 | null\n -800 | 0\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::ONE, "exponent")],
        outputs: &[
            Port::real("out", UnitRule::ONE, "e to the power of the number").within(0.0, f64::MAX),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::exp);
    })],
);
