//! `Max`: out = the larger of a and b; null if either is null.

use crate::primitive::{
    CatalogueEntry, Example, Int, Operation, Port, Real, Spec, UnitRule, by_element, int_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Max",
        summary: "The larger of two numbers; for vectors, arrays and matrices, element by element.",
        examples: &[Example::new(
            "numbers",
            "",
            "a | b | out
             0.5 | 0.25 | 0.5
             -1.5 | -2.5 | -1.5
             null | 1.0 | null",
        )],
        inputs: &[
            Port::linear("a", UnitRule::Var(0), "first operand"),
            Port::linear("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::linear("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &const { by_element::<Max>() },
);

/// The larger of two numbers.
#[derive(Clone, Copy)]
pub struct Max;

impl Operation<Real> for Max {
    #[inline(always)]
    fn apply(a: Real, b: Real) -> Real {
        if a.is_nan() | (a > b) { a } else { b }
    }
}

impl Operation<Int> for Max {
    #[inline(always)]
    fn apply(a: Int, b: Int) -> Int {
        int_unless(a, b, (a.max(b), false))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{check_binary, check_int};

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Max",
            &[[1.0, 2.0, 2.0], [2.0, -1.0, 2.0], [f64::MAX, 0.0, f64::MAX]],
        );
        check_int("Max", &[[1, 2, 2], [2, -1, 2]]);
    }
}
