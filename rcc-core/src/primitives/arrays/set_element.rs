//! `SetElement`: an array with one element replaced, by a computed index.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Dim, Element, ElementType, Example, Int, Kernel, Port, PortType, Real,
    Slot, Spec, Step, UnitRule, copy, fill_null, operands,
};

const ARRAY: PortType = PortType::Array(ElementType::Open, Dim::Var(0));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SetElement",
        summary: "An array with the element at an index replaced.",
        null: "null elements are passed through, a null value is stored; a null index gives null in every element",
        undefined: "index < 0 or index ≥ the length",
        inputs: &[
            Port::new("in", ARRAY, UnitRule::Var(0), "the array"),
            Port::int("index", "index of the element, from 0"),
            Port::new("value", PortType::Scalar, UnitRule::Var(0), "its new value"),
        ],
        outputs: &[Port::new("out", ARRAY, UnitRule::Var(0), "the new array")],
        examples: &[Example::new(
            "an index inside and outside",
            "",
            "in | index | value | out
             [4.0, 5.5, 6.0] | 1 | 7.0 | [4.0, 7.0, 6.0]
             [4.0, 5.5, 6.0] | 3 | 7.0 | null",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::each::<SetElement<Real>>(),
        Kernel::each::<SetElement<Bool>>(),
        Kernel::each::<SetElement<Int>>(),
    ],
);

operands! {
    struct SetElement<E> { input: Slot<E>, index: Slot<Int>, value: Slot<E>, out: Slot<E>, length: u32 }
}

impl<E: Element> Step for SetElement<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        match u32::try_from(frame.get(self.index)?) {
            Ok(index) if index < self.length => {
                copy(frame, self.input, self.out, self.length)?;
                copy(frame, self.value, self.out + index, 1)
            }
            _ => fill_null(frame, self.out, self.length),
        }
    }
}
