//! `Subtract`: out = a - b, rounded once; an `Int` overflow gives null.

use crate::primitive::{
    CatalogueEntry, Example, Int, Operation, Port, Real, Spec, UnitRule, by_element, int_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Subtract",
        summary: "The difference of two numbers, vectors, arrays or matrices of the same unit.",
        null: "a null input gives null, element by element",
        undefined: "overflow",
        examples: &[
            Example::new(
                "numbers",
                "",
                "a | b | out
             0.5 | 0.25 | 0.25
             null | 1.0 | null",
            ),
            Example::new(
                "integers",
                "",
                "a | b | out
             2 | 3 | -1",
            ),
            Example::new(
                "arrays by element",
                "",
                "a | b | out
             [1.0, 2.0] | [0.5, -2.5] | [0.5, 4.5]",
            ),
        ],
        inputs: &[
            Port::linear("a", UnitRule::Var(0), "first operand"),
            Port::linear("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::linear("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &const { by_element::<Subtract>() },
);

/// a − b.
#[derive(Clone, Copy)]
pub struct Subtract;

impl Operation<Real> for Subtract {
    #[inline(always)]
    fn apply(a: Real, b: Real) -> Real {
        a - b
    }
}

impl Operation<Int> for Subtract {
    #[inline(always)]
    fn apply(a: Int, b: Int) -> Int {
        int_unless(a, b, a.overflowing_sub(b))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{check_binary, check_int};
    use crate::types::NULL_INT;

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Subtract",
            &[
                [1.0, 2.0, -1.0],
                [0.3, 0.1, 0.19999999999999998],
                [1e308, -1e308, f64::NAN],
            ],
        );
        check_int(
            "Subtract",
            &[
                [1, 2, -1],
                [1 - i64::MAX, 1, -i64::MAX],
                [i64::MAX, -1, NULL_INT],
                [-i64::MAX, 2, NULL_INT],
            ],
        );
    }
}
