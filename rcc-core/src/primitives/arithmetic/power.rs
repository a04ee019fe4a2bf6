//! `Power`: one dimensionless number to the power of another.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each_finite};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Power",
        summary: "A number to the power of another.",
        undefined: "a negative base with a fractional exponent; 0 to a negative power; overflow",
        formula: "out = base^exponent; libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "integer and fractional exponents, and undefined results",
            "",
            "base | exponent | out
             2 | 10 | 1024
             2 | -1 | 0.5
             9 | 0.5 | 3
             -2 | 3 | -8
             0 | 0 | 1
             -8 | 0.5 | null
             0 | -1 | null
             10 | 309 | null
             null | 0 | null
             1 | null | null",
        )],
        inputs: &[
            Port::real("base", UnitRule::ONE, "base"),
            Port::real("exponent", UnitRule::ONE, "exponent"),
        ],
        outputs: &[Port::real("out", UnitRule::ONE, "result")],
        ..Spec::PLAIN
    },
    // pow(NaN, 0) and pow(1, NaN) are 1 by definition.
    &[Kernel::new(|frame, operands| {
        each_finite(frame, operands, libm::pow);
    })],
);
