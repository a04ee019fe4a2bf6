//! `Max`: out = the larger of a and b; null if either is null.

use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Spec, UnitRule, each_int, each_real, wide_int, wide_real,
};
use crate::types::Store;

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
    &[
        Kernel::single(Store::Real, |frame, operands| {
            each_real(
                frame,
                operands,
                |a, b| if a.is_nan() | (a > b) { a } else { b },
            );
        }),
        Kernel::of(Store::Real, |frame, operands| {
            wide_real(
                frame,
                operands,
                |a, b| if a.is_nan() | (a > b) { a } else { b },
            );
        }),
        Kernel::single(Store::Int, |frame, operands| {
            each_int(frame, operands, |a, b| (a.max(b), false));
        }),
        Kernel::of(Store::Int, |frame, operands| {
            wide_int(frame, operands, |a, b| (a.max(b), false));
        }),
    ],
);

#[cfg(test)]
mod tests {
    use crate::testing::{check_binary, check_int};

    #[test]
    fn worked_values_and_null() {
        check_binary(
            "Max",
            &[
                [1.0, 2.0, 2.0],
                [2.0, -1.0, 2.0],
                [f64::INFINITY, 0.0, f64::INFINITY],
            ],
        );
        check_int("Max", &[[1, 2, 2], [2, -1, 2]]);
    }
}
