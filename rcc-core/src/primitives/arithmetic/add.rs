//! `Add`: out = a + b, rounded once; an `Int` overflow gives null.

use crate::primitive::{
    CatalogueEntry, Example, Int, Operation, Port, Real, Spec, UnitRule, by_element, int_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Add",
        summary: "The sum of two numbers, vectors, arrays or matrices of the same unit.",
        null: "a null input gives null, element by element",
        undefined: "overflow",
        examples: &[
            Example::new(
                "numbers",
                "",
                "a | b | out
             0.5 | 0.25 | 0.75
             -1.5 | 1.5 | 0
             null | 1.0 | null",
            ),
            Example::new(
                "integers",
                "",
                "a | b | out
             2 | 3 | 5
             -2 | 3 | 1",
            ),
            Example::new(
                "arrays by element",
                "",
                "a | b | out
             [1.0, 2.0] | [0.5, -2.5] | [1.5, -0.5]",
            ),
        ],
        inputs: &[
            Port::linear("a", UnitRule::Var(0), "first operand"),
            Port::linear("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::linear("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &const { by_element::<Add>() },
);

/// a + b.
#[derive(Clone, Copy)]
pub struct Add;

impl Operation<Real> for Add {
    #[inline(always)]
    fn apply(a: Real, b: Real) -> Real {
        a + b
    }
}

impl Operation<Int> for Add {
    #[inline(always)]
    fn apply(a: Int, b: Int) -> Int {
        int_unless(a, b, a.overflowing_add(b))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{check_binary, check_int};
    use crate::types::NULL_INT;

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Add",
            &[
                [1.0, 2.0, 3.0],
                [0.1, 0.2, 0.30000000000000004],
                [1e308, 1e308, f64::NAN],
                [-1e308, -1e308, f64::NAN],
                [f64::MAX, f64::MIN, 0.0],
            ],
        );
        check_int(
            "Add",
            &[
                [1, 2, 3],
                [i64::MAX, -1, i64::MAX - 1],
                [i64::MAX, 1, NULL_INT],
                [-i64::MAX, -1, NULL_INT],
                [-i64::MAX, -2, NULL_INT],
            ],
        );
    }
}
