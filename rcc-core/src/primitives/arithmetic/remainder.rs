//! `Remainder`: the remainder of a division. It has the sign of the dividend, like MOD of IEC 61131-3 and `fmod` of C;
//! to bring an angle into one turn use `Wrap`.

use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each_finite, each_int,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Remainder",
        summary: "The remainder of a division; it has the sign of the dividend.",
        undefined: "b = 0; overflow: an infinite a",
        formula: "out = a - b · truncate(a / b), exact (fmod of ISO C, 7.12.10.1)",
        examples: &[
            Example::new(
                "the sign is that of a",
                "",
                "a | b | out
                 7.5 | 2.0 | 1.5
                 -7.5 | 2.0 | -1.5
                 7.5 | -2.0 | 1.5
                 6.0 | 2.0 | 0.0
                 1.0 | 0.0 | null
                 null | 2.0 | null",
            ),
            Example::new(
                "integers",
                "",
                "a | b | out
                 7 | 3 | 1
                 -7 | 3 | -1
                 7 | -3 | 1
                 7 | 0 | null
                 null | 3 | null",
            )
            .whole(),
        ],
        inputs: &[
            Port::number("a", UnitRule::Var(0), "dividend"),
            Port::number("b", UnitRule::Var(0), "divisor"),
        ],
        outputs: &[Port::number(
            "out",
            UnitRule::Var(0),
            "remainder, smaller than b in magnitude",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            each_finite(frame, operands, libm::fmod);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each_int(frame, operands, |a, b| {
                let remainder = a.checked_rem(b);
                (remainder.unwrap_or(0), remainder.is_none())
            });
        }),
    ],
);
