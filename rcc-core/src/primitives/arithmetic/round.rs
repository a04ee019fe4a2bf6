//! `Round`: the nearest integer; halves are rounded away from zero.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_whole};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Round",
        summary: "A number rounded to the nearest integer; halves are rounded away from zero.",
        undefined: "overflow: a result beyond ±(2^63 - 1)",
        formula: "out = ⌊|in| + 1/2⌋ with the sign of in",
        examples: &[Example::new(
            "positive, negative, and beyond the range of Int",
            "",
            "in | out\n 0.4 | 0\n 0.5 | 1\n -0.5 | -1\n 2.5 | 3\n 1e19 | null\n -1e19 | null\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "number, in any unit")],
        outputs: &[Port::int("out", "integer, without unit")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_whole(frame, operands, libm::round);
    })],
);
