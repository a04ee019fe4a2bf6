//! `Equals`: true if two values of one scalar type are equal; numbers within a tolerance.
//!
//! `Real`: |a - b| ≤ tolerance (default 0: bitwise equality, except that 0 = -0). `Bool` and `Int`: exactly.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Element, Example, Int, Kernel, Parameter, ParameterKind,
    Port, PortType, Real, Slot, Spec, Step, UnitRule, operands,
};
use crate::types::{NULL_BOOL, Type};

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
        Kernel::each::<Equals<Real>>(),
        Kernel::each::<Equals<Bool>>(),
        Kernel::each::<Equals<Int>>(),
    ],
);

operands! {
    struct Equals<E> { a: Slot<E>, b: Slot<E>, out: Slot<Bool>, tolerance: Slot<Real> }
}

impl Step for Equals<Real> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b) = (frame.get(self.a)?, frame.get(self.b)?);
        // The difference of equal infinities is NaN, hence the first comparison.
        let equal = (a == b) | ((a - b).abs() <= frame.get(self.tolerance)?);
        frame.put(self.out, equality([a, b], equal))
    }
}

impl Step for Equals<Bool> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b) = (frame.get(self.a)?, frame.get(self.b)?);
        frame.put(self.out, equality([a, b], a == b))
    }
}

impl Step for Equals<Int> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (a, b) = (frame.get(self.a)?, frame.get(self.b)?);
        frame.put(self.out, equality([a, b], a == b))
    }
}

#[inline(always)]
fn equality<E: Element>([a, b]: [E; 2], equal: bool) -> Bool {
    if a.is_null() | b.is_null() {
        NULL_BOOL
    } else {
        u8::from(equal)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::{NULL_INT, Store};

    #[test]
    fn numbers_are_equal_within_the_tolerance() {
        let mut bench = PrimitiveHarness::wide("Equals", Some(Store::Real), 1);
        bench.set_real("tolerance", 0.1);
        let most = f64::MAX;
        for (a, b, out) in [
            (1.0, 1.05, Some(true)),
            (1.0, 1.2, Some(false)),
            (most, most, Some(true)),
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
