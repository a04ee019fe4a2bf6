//! `Multiply`: out = a · b, rounded once; an `Int` overflow gives null.

use crate::primitive::{
    CatalogueEntry, Example, Int, Kernel, Operation, Port, Real, Spec, UnitRule, each_pair,
    int_unless,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Multiply",
        summary: "The product of two numbers; its unit is the product of theirs.",
        null: "a null input gives null, and so does an integer out of range",
        undefined: "overflow",
        examples: &[
            Example::new(
                "real numbers",
                "",
                "a | b | out
                 2.5 | 4.0 | 10.0
                 -2.0 | 0.5 | -1.0
                 null | 0.0 | null",
            ),
            Example::new(
                "a bare number gets a unit",
                "",
                "a | b | out
                 2.5 | 1 mm | 2.5 mm",
            ),
            Example::new(
                "integers",
                "",
                "a | b | out
                 6 | -7 | -42
                 4611686018427387904 | 2 | null
                 null | 0 | null",
            )
            .whole(),
        ],
        inputs: &[
            Port::number("a", UnitRule::Var(0), "first operand"),
            Port::number("b", UnitRule::Var(1), "second operand"),
        ],
        outputs: &[Port::number("out", UnitRule::Product(0, 1), "result")],
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, each_pair::<Real, Multiply>),
        Kernel::of(Store::Int, each_pair::<Int, Multiply>),
    ],
);

/// a · b.
#[derive(Clone, Copy)]
pub struct Multiply;

impl Operation<Real> for Multiply {
    #[inline(always)]
    fn apply(a: Real, b: Real) -> Real {
        a * b
    }
}

impl Operation<Int> for Multiply {
    #[inline(always)]
    fn apply(a: Int, b: Int) -> Int {
        int_unless(a, b, a.overflowing_mul(b))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{check_binary, check_int};
    use crate::types::NULL_INT;

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Multiply",
            &[
                [2.0, 3.0, 6.0],
                [-0.5, 4.0, -2.0],
                [1e200, -1e200, f64::NAN],
            ],
        );
        check_int(
            "Multiply",
            &[
                [2, -3, -6],
                [1 << 62, 2, NULL_INT],
                [i64::MAX, -1, -i64::MAX],
            ],
        );
    }
}
