//! `Select`: selects one of two values of any type, by a condition.
//!
//! Null depends only on the condition and the selected value.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Element, Example, Int, Kernel, NullRule, Port, PortType, Real, Slot,
    Spec, Step, UnitRule, choose, copy, fill_null, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Select",
        summary: "Selects one of two values, by a condition.",
        null: "a null condition gives null; among the values, only the selected one matters",
        null_rule: NullRule::FirstAndAnyKnown,
        examples: &[
            Example::new(
                "only the condition and the selected value matter",
                "",
                "condition | yes | no | out
                 true | 1.5 | 2.5 | 1.5
                 false | 1.5 | 2.5 | 2.5
                 true | 1.5 | null | 1.5
                 false | 1.5 | null | null
                 null | 1.5 | 2.5 | null",
            ),
            Example::new(
                "vectors of integers",
                "",
                "condition | yes | no | out
                 true | [1, 2] | [3, 4] | [1, 2]
                 false | [1, 2] | [3, 4] | [3, 4]",
            ),
        ],
        inputs: &[
            Port::bool("condition", "condition"),
            Port::new(
                "yes",
                PortType::Any,
                UnitRule::Var(0),
                "value while the condition is true",
            ),
            Port::new(
                "no",
                PortType::Any,
                UnitRule::Var(0),
                "value while the condition is false",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "selected value",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::scalar::<Select<Real>>(),
        Kernel::each::<WideSelect<Real>>(),
        Kernel::scalar::<Select<Bool>>(),
        Kernel::each::<WideSelect<Bool>>(),
        Kernel::scalar::<Select<Int>>(),
        Kernel::each::<WideSelect<Int>>(),
    ],
);

operands! {
    struct Select<E> { condition: Slot<Bool>, yes: Slot<E>, no: Slot<E>, out: Slot<E> }
}

impl<E: Element> Step for Select<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let condition = frame.get(self.condition)?;
        let value = frame.get(choose(condition == 1, self.yes, self.no))?;
        frame.put(self.out, value.unless(condition.is_null()))
    }
}

operands! {
    struct WideSelect<E> { condition: Slot<Bool>, yes: Slot<E>, no: Slot<E>, out: Slot<E>, width: u32 }
}

impl<E: Element> Step for WideSelect<E> {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        match frame.get(self.condition)? {
            0 => copy(frame, self.no, self.out, self.width),
            1 => copy(frame, self.yes, self.out, self.width),
            _ => fill_null(frame, self.out, self.width),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::{NULL_INT, Store};

    #[test]
    fn only_the_selected_value_matters() {
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Real), 3);
        bench.set_reals("yes", &[1.0, 2.0, 3.0]);
        assert_eq!(
            bench
                .set_bool("condition", Some(true))
                .step()
                .reals("out", 3),
            [1.0, 2.0, 3.0]
        );
        assert!(
            bench
                .set_bool("condition", Some(false))
                .step()
                .reals("out", 3)
                .iter()
                .all(|v| v.is_nan())
        );
        assert!(
            bench
                .set_bool("condition", None)
                .step()
                .reals("out", 3)
                .iter()
                .all(|v| v.is_nan())
        );
    }

    #[test]
    fn arrays_are_selected_as_a_whole() {
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Bool), 2);
        bench
            .set_bool("condition", Some(false))
            .set_bool("no", Some(true));
        assert_eq!(bench.step().bool("out"), Some(true));
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Int), 2);
        bench.set_bool("condition", Some(true)).set_int("yes", 7);
        assert_eq!(bench.step().int("out"), 7);
    }

    #[test]
    fn works_for_single_values() {
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Real), 1);
        bench.set_real("yes", 1.0).set_bool("condition", Some(true));
        assert_eq!(bench.step().real("out"), 1.0);
        for condition in [Some(false), None] {
            let out = bench.set_bool("condition", condition).step().real("out");
            assert!(out.is_nan(), "{condition:?}");
        }

        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Bool), 1);
        bench
            .set_bool("yes", Some(true))
            .set_bool("no", Some(false))
            .set_bool("condition", Some(true));
        assert_eq!(bench.step().bool("out"), Some(true));
        let mut bench = PrimitiveHarness::wide("Select", Some(Store::Int), 1);
        bench
            .set_int("yes", 7)
            .set_int("no", 8)
            .set_bool("condition", Some(false));
        assert_eq!(bench.step().int("out"), 8);
        assert_eq!(
            bench.set_bool("condition", None).step().int("out"),
            NULL_INT
        );
    }
}
