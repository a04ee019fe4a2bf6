//! `NullIf`: a value of any type, or null while a condition is true.
//!
//! `NullIf` produces null, `OrElse` replaces it and `IsNull` tests for it.

use crate::frame::Frame;
use crate::primitive::{
    Bool, ByElement, CatalogueEntry, Element, Example, Int, Kernel, Port, PortType, Real, Slot,
    Spec, Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "NullIf",
        summary: "A value, or null while a condition is true.",
        null: "a null value gives null, and so does a null condition",
        undefined: "the condition is true",
        examples: &[Example::new(
            "a number, unless the condition is true or null",
            "",
            "in | condition | out
                 1.5 | false | 1.5
                 1.5 | true | null
                 1.5 | null | null
                 null | false | null",
        )],
        inputs: &[
            Port::new("in", PortType::Any, UnitRule::Var(0), "value to pass on"),
            Port::bool("condition", "while true, the output is null"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "the input, or null",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::scalar::<NullIf<Real>>(),
        Kernel::by_element::<NullIf<Real>>(),
        Kernel::scalar::<NullIf<Bool>>(),
        Kernel::by_element::<NullIf<Bool>>(),
        Kernel::scalar::<NullIf<Int>>(),
        Kernel::by_element::<NullIf<Int>>(),
    ],
);

operands! {
    struct NullIf<E> { input: Slot<E>, condition: Slot<Bool>, out: Slot<E> }
}

impl<E: Element> Step for NullIf<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (value, condition) = (frame.get(self.input)?, frame.get(self.condition)?);
        frame.put(self.out, value.unless(condition != 0))
    }
}

impl<E: Element> ByElement for NullIf<E>
where
    NullIf<E>: Step,
{
    #[inline(always)]
    fn element(self, i: u32) -> Self {
        NullIf {
            input: self.input + i,
            out: self.out + i,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::{NULL_INT, Store};

    #[test]
    fn only_a_false_condition_passes_the_value() {
        for width in [1, 2] {
            let mut bench = PrimitiveHarness::wide("NullIf", Some(Store::Real), width);
            bench.set_real("in", 2.0);
            assert_eq!(
                bench.set_bool("condition", Some(false)).step().real("out"),
                2.0
            );
            for condition in [Some(true), None] {
                let out = bench.set_bool("condition", condition).step().real("out");
                assert!(out.is_nan(), "{condition:?}");
            }
            let mut bench = PrimitiveHarness::wide("NullIf", Some(Store::Bool), width);
            bench.set_bool("in", Some(true));
            assert_eq!(
                bench.set_bool("condition", Some(false)).step().bool("out"),
                Some(true)
            );
            assert_eq!(
                bench.set_bool("condition", Some(true)).step().bool("out"),
                None
            );
            let mut bench = PrimitiveHarness::wide("NullIf", Some(Store::Int), width);
            bench.set_int("in", 3);
            assert_eq!(
                bench.set_bool("condition", Some(false)).step().int("out"),
                3
            );
            assert_eq!(
                bench.set_bool("condition", None).step().int("out"),
                NULL_INT
            );
        }
    }
}
