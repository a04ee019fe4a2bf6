//! `OrElse`: a value, or a replacement while it is null.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Element, Example, Int, Kernel, NullRule, Port, PortType, Real, Slot,
    Spec, Step, UnitRule, choose, copy, is_null, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "OrElse",
        summary: "A value, or a replacement while the first is null.",
        null: "a null `in`, or one with a null element, gives `other`; null only if both are null",
        null_rule: NullRule::AnyKnown,
        examples: &[Example::new(
            "the replacement while the first is null",
            "",
            "in | other | out
             0.5 | 9.5 | 0.5
             null | 9.5 | 9.5
             null | null | null",
        )],
        inputs: &[
            Port::new("in", PortType::Any, UnitRule::Var(0), "primary value"),
            Port::new("other", PortType::Any, UnitRule::Var(0), "replacement"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "`in`, or `other`",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::scalar::<OrElse<Real>>(),
        Kernel::each::<WideOrElse<Real>>(),
        Kernel::scalar::<OrElse<Bool>>(),
        Kernel::each::<WideOrElse<Bool>>(),
        Kernel::scalar::<OrElse<Int>>(),
        Kernel::each::<WideOrElse<Int>>(),
    ],
);

operands! {
    struct OrElse<E> { input: Slot<E>, other: Slot<E>, out: Slot<E> }
}

impl<E: Element> Step for OrElse<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let null = frame.get(self.input)?.is_null();
        let value = frame.get(choose(null, self.other, self.input))?;
        frame.put(self.out, value)
    }
}

operands! {
    struct WideOrElse<E> { input: Slot<E>, other: Slot<E>, out: Slot<E>, width: u32 }
}

impl<E: Element> Step for WideOrElse<E> {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let null = is_null(frame, self.input, self.width)?;
        let source = if null { self.other } else { self.input };
        copy(frame, source, self.out, self.width)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::{NULL_INT, Store};

    #[test]
    fn replaces_null_and_nothing_else() {
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Real), 1);
        assert_eq!(
            bench
                .set_real("in", f64::NAN)
                .set_real("other", 2.0)
                .step()
                .real("out"),
            2.0
        );
        assert_eq!(bench.set_real("in", 1.0).step().real("out"), 1.0);
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Bool), 1);
        assert_eq!(
            bench
                .set_bool("in", None)
                .set_bool("other", Some(true))
                .step()
                .bool("out"),
            Some(true)
        );
        assert_eq!(
            bench.set_bool("in", Some(false)).step().bool("out"),
            Some(false)
        );
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Int), 1);
        assert_eq!(
            bench
                .set_int("in", NULL_INT)
                .set_int("other", 5)
                .step()
                .int("out"),
            5
        );
    }

    #[test]
    fn a_null_composite_is_replaced_whole() {
        let mut bench = PrimitiveHarness::wide("OrElse", Some(Store::Real), 3);
        bench
            .set_reals("in", &[1.0, 2.0, f64::NAN])
            .set_reals("other", &[7.0, 8.0, 9.0]);
        assert_eq!(bench.step().reals("out", 3), [7.0, 8.0, 9.0]);
    }
}
