//! `Min`: out = the smaller of a and b; null if either is null.

use crate::primitive::{
    CatalogueEntry, Example, Int, Operation, Port, Real, Spec, UnitRule, by_element, int_unless,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Min",
        summary: "The smaller of two numbers; for vectors, arrays and matrices, element by element.",
        examples: &[Example::new(
            "numbers",
            "",
            "a | b | out
             0.5 | 0.25 | 0.25
             -1.5 | -2.5 | -2.5
             null | 1.0 | null",
        )],
        inputs: &[
            Port::linear("a", UnitRule::Var(0), "first operand"),
            Port::linear("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::linear("out", UnitRule::Var(0), "result")],
        ..Spec::PLAIN
    },
    &const { by_element::<Min>() },
);

/// The smaller of two numbers.
#[derive(Clone, Copy)]
pub struct Min;

impl Operation<Real> for Min {
    #[inline(always)]
    fn apply(a: Real, b: Real) -> Real {
        if a.is_nan() | (a < b) { a } else { b }
    }
}

impl Operation<Int> for Min {
    #[inline(always)]
    fn apply(a: Int, b: Int) -> Int {
        int_unless(a, b, (a.min(b), false))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{check_binary, check_int};

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Min",
            &[
                [1.0, 2.0, 1.0],
                [2.0, -1.0, -1.0],
                [f64::MIN, 0.0, f64::MIN],
            ],
        );
        check_int("Min", &[[1, 2, 1], [2, -1, -1]]);
    }
}
