//! `Truncate`: a number without its fractional part.

use crate::primitive::{CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, map_whole};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Truncate",
        summary: "A number rounded towards zero to an integer.",
        undefined: "overflow: a result beyond ±(2^63 - 1)",
        formula: "out = ⌊|in|⌋ with the sign of in (TRUNC of IEC 61131-3)",
        examples: &[Example::new(
            "positive, negative, and beyond the range of Int",
            "",
            "in | out\n 1.9 | 1\n -1.9 | -1\n 2 | 2\n 1e19 | null\n -1e19 | null\n null | null",
        )],
        inputs: &[Port::real("in", UnitRule::Var(0), "number, in any unit")],
        outputs: &[Port::int("out", "integer, without unit")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        map_whole(frame, operands, libm::trunc);
    })],
);
