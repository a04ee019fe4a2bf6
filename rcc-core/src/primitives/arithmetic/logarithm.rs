//! `Logarithm`: the natural logarithm; divide by the logarithm of another base to convert.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_real};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Logarithm",
        summary: "The natural logarithm of a number.",
        undefined: "in <= 0; overflow: an infinite number",
        formula: "out = ln(in); libm (from FreeBSD msun), error below 1 unit in the last place",
        examples: &[Example::new(
            "of e, 1 and 0",
            "",
            "in | out\n 2.718281828459045 | 1\n 1 | 0\n 0.5 | -0.6931471805599453\n 0 | null\n -1 | null\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::ONE, "number, above 0")],
        outputs: &[Port::real("out", UnitRule::ONE, "natural logarithm")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_real(frame, operands, libm::log);
    })],
);
