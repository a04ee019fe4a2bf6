//! `IsNull`: true if a value of any type is null. Its output is never null.
//!
//! An array or composite counts as null if any of its elements is.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Element, Example, Int, Kernel, NullRule, Port, PortType, Real, Slot,
    Spec, Step, UnitRule, is_null, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "IsNull",
        summary: "True while its input is null.",
        null: "a null input gives true, and so does an array or vector with a null element; the output is never null",
        null_rule: NullRule::Known,
        examples: &[Example::new(
            "a number that is null for one cycle",
            "",
            "in | out
             0.5 | false
             null | true
             0.0 | false",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Any,
            UnitRule::Var(0),
            "value to test",
        )],
        outputs: &[Port::bool("out", "in is null")],
        ..Spec::PLAIN
    },
    &[
        Kernel::scalar::<IsNull<Real>>(),
        Kernel::each::<WideIsNull<Real>>(),
        Kernel::scalar::<IsNull<Bool>>(),
        Kernel::each::<WideIsNull<Bool>>(),
        Kernel::scalar::<IsNull<Int>>(),
        Kernel::each::<WideIsNull<Int>>(),
    ],
);

operands! {
    struct IsNull<E> { input: Slot<E>, out: Slot<Bool> }
}

impl<E: Element> Step for IsNull<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let null = frame.get(self.input)?.is_null();
        frame.put(self.out, u8::from(null))
    }
}

operands! {
    struct WideIsNull<E> { input: Slot<E>, out: Slot<Bool>, width: u32 }
}

impl<E: Element> Step for WideIsNull<E> {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let null = is_null(frame, self.input, self.width)?;
        frame.put(self.out, u8::from(null))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;
    use crate::types::{NULL_INT, Store};

    #[test]
    fn detects_null_in_every_arena() {
        let mut bench = PrimitiveHarness::wide("IsNull", Some(Store::Real), 7);
        assert_eq!(bench.step().bool("out"), Some(true));
        assert_eq!(
            bench.set_reals("in", &[0.0; 7]).step().bool("out"),
            Some(false)
        );
        let mut bench = PrimitiveHarness::wide("IsNull", Some(Store::Bool), 1);
        assert_eq!(bench.set_bool("in", None).step().bool("out"), Some(true));
        assert_eq!(
            bench.set_bool("in", Some(false)).step().bool("out"),
            Some(false)
        );
        let mut bench = PrimitiveHarness::wide("IsNull", Some(Store::Int), 1);
        assert_eq!(bench.set_int("in", NULL_INT).step().bool("out"), Some(true));
        assert_eq!(bench.set_int("in", 0).step().bool("out"), Some(false));
    }
}
