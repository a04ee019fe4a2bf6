//! `Greater`: out = a > b, for two numbers of the same unit; null if either is null.

use crate::primitive::{CatalogueEntry, Example, Int, Kernel, Port, Real, Spec, UnitRule, compare};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Greater",
        summary: "True while the first number is greater than the second.",
        examples: &[
            Example::new(
                "strictly greater; for greater or equal use `Not` after `Less`",
                "",
                "a | b | out
                 2.0 | 1.0 | true
                 1.0 | 1.0 | false
                 null | 1.0 | null",
            ),
            Example::new(
                "integers",
                "",
                "a | b | out
                 2 | 1 | true
                 1 | 2 | false",
            )
            .whole(),
        ],
        inputs: &[
            Port::number("a", UnitRule::Var(0), "first operand"),
            Port::number("b", UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::bool("out", "a > b")],
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            compare::<Real>(frame, operands, |a, b| a > b);
        }),
        Kernel::of(Store::Int, |frame, operands| {
            compare::<Int>(frame, operands, |a, b| a > b);
        }),
    ],
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;
    use crate::types::NULL_INT;

    #[test]
    fn compares_and_propagates_null() {
        let mut bench = PrimitiveHarness::wide("Greater", Some(Store::Real), 1);
        for (a, b) in [(1.0, 2.0), (2.0, 1.0), (1.0, 1.0), (f64::MIN, f64::MAX)] {
            bench.set_real("a", a).set_real("b", b).step();
            assert_eq!(bench.bool("out"), Some(a > b));
        }
        for (a, b) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
            bench.set_real("a", a).set_real("b", b).step();
            assert_eq!(bench.bool("out"), None);
        }
    }

    #[test]
    fn whole_numbers_are_compared_exactly() {
        let mut bench = PrimitiveHarness::wide("Greater", Some(Store::Int), 1);
        for (a, b) in [(1, 2), (2, 1), (1, 1), (i64::MAX, i64::MAX - 1)] {
            bench.set_int("a", a).set_int("b", b).step();
            assert_eq!(bench.bool("out"), Some(a > b));
        }
        for (a, b) in [(NULL_INT, 1), (1, NULL_INT)] {
            bench.set_int("a", a).set_int("b", b).step();
            assert_eq!(bench.bool("out"), None);
        }
    }
}
