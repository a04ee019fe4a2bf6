//! `Equals`: true if two values of one scalar type are equal; numbers within a tolerance.
//!
//! `Real`: |a - b| ≤ tolerance (default 0: bitwise equality, except that 0 = -0). `Bool` and `Int`: exactly.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Parameter, ParameterKind, Port, PortType, Spec,
    UnitRule, each,
};
use crate::types::{NULL_BOOL, NULL_INT, Store, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Equals",
        summary: "True while two values are equal.",
        examples: &[
            Example::new(
                "within a tolerance",
                "{tolerance: 0.1}",
                "a | b | out
                 1.0 | 1.05 | true
                 1.0 | 1.2 | false
                 null | 1.0 | null",
            ),
            Example::new(
                "Bools",
                "",
                "a | b | out
                 true | true | true
                 true | false | false",
            ),
            Example::new(
                "integers",
                "",
                "a | b | out
                 3 | 3 | true
                 3 | 4 | false
                 null | 3 | null",
            )
            .whole(),
        ],
        inputs: &[
            Port::new("a", PortType::Scalar, UnitRule::Var(0), "first operand"),
            Port::new("b", PortType::Scalar, UnitRule::Var(0), "second operand"),
        ],
        outputs: &[Port::bool("out", "a = b")],
        parameters: &[Parameter::new(
            "tolerance",
            ParameterKind::Value(PortType::Is(Type::Real), UnitRule::Var(0)),
            "largest difference of two numbers that count as equal; ignored for Bool and Int",
        )
        .default(DefaultValue::Real(0.0))
        .at_least(0.0)],
        ..Spec::PLAIN
    },
    &[
        Kernel::of(Store::Real, |frame, operands| {
            each(frame, operands, step_real)
        }),
        Kernel::of(Store::Bool, |frame, operands| {
            each(frame, operands, step_bool)
        }),
        Kernel::of(Store::Int, |frame, operands| {
            each(frame, operands, step_int)
        }),
    ],
);

#[inline(always)]
fn step_real(frame: &mut Frame<'_>, [a, b, out, tolerance]: [u32; 4]) {
    let (a, b) = (frame.real(a), frame.real(b));
    // The difference of equal infinities is NaN, hence the first comparison.
    let result = u8::from((a == b) | ((a - b).abs() <= frame.real(tolerance)));
    frame.set_bool(
        out,
        if a.is_nan() | b.is_nan() {
            NULL_BOOL
        } else {
            result
        },
    );
}

#[inline(always)]
fn step_bool(frame: &mut Frame<'_>, [a, b, out, _tolerance]: [u32; 4]) {
    let (a, b) = (frame.bool(a), frame.bool(b));
    frame.set_bool(
        out,
        if (a | b) & NULL_BOOL != 0 {
            NULL_BOOL
        } else {
            u8::from(a == b)
        },
    );
}

#[inline(always)]
fn step_int(frame: &mut Frame<'_>, [a, b, out, _tolerance]: [u32; 4]) {
    let (a, b) = (frame.int(a), frame.int(b));
    let null = (a == NULL_INT) | (b == NULL_INT);
    frame.set_bool(out, if null { NULL_BOOL } else { u8::from(a == b) });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn numbers_are_equal_within_the_tolerance() {
        let mut bench = PrimitiveHarness::wide("Equals", Some(Store::Real), 1);
        bench.set_real("tolerance", 0.1);
        let inf = f64::INFINITY;
        for (a, b, out) in [
            (1.0, 1.05, Some(true)),
            (1.0, 1.2, Some(false)),
            (inf, inf, Some(true)),
            (f64::NAN, 1.0, None),
        ] {
            assert_eq!(
                bench.set_real("a", a).set_real("b", b).step().bool("out"),
                out
            );
        }
    }

    #[test]
    fn bools_and_ints_are_compared_exactly() {
        let mut bench = PrimitiveHarness::wide("Equals", Some(Store::Bool), 1);
        assert_eq!(
            bench
                .set_bool("a", Some(true))
                .set_bool("b", Some(true))
                .step()
                .bool("out"),
            Some(true)
        );
        assert_eq!(bench.set_bool("b", None).step().bool("out"), None);
        let mut bench = PrimitiveHarness::wide("Equals", Some(Store::Int), 1);
        assert_eq!(
            bench.set_int("a", 3).set_int("b", 4).step().bool("out"),
            Some(false)
        );
        assert_eq!(bench.set_int("b", NULL_INT).step().bool("out"), None);
    }
}
