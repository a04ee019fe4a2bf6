//! `At`: an element of an array, by a computed index. A fixed element is written as a link: `a.out[2]`.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Dim, Element, ElementType, Example, Int, Kernel, Port, PortType, Real,
    Slot, Spec, Step, UnitRule, copy, operands,
};

const LENGTH: Dim = Dim::Var(0);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "At",
        summary: "The element of an array at an index.",
        undefined: "index < 0 or index ≥ the length",
        inputs: &[
            Port::new(
                "in",
                PortType::Array(ElementType::Open, LENGTH),
                UnitRule::Var(0),
                "the array",
            ),
            Port::int("index", "index of the element, from 0"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Scalar,
            UnitRule::Var(0),
            "the element",
        )],
        examples: &[Example::new(
            "an index inside and outside",
            "",
            "in | index | out
             [4.0, 5.5, 6.0] | 1 | 5.5
             [4.0, 5.5, 6.0] | 3 | null
             [4.0, 5.5, 6.0] | -1 | null
             [4.0, 5.5, 6.0] | null | null",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::each::<At<Real>>(),
        Kernel::each::<At<Bool>>(),
        Kernel::each::<At<Int>>(),
    ],
);

operands! {
    struct At<E> { input: Slot<E>, index: Slot<Int>, out: Slot<E>, length: u32 }
}

impl<E: Element> Step for At<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        // A null index is negative.
        match u32::try_from(frame.get(self.index)?) {
            Ok(index) if index < self.length => copy(frame, self.input + index, self.out, 1),
            _ => frame.put(self.out, E::NULL),
        }
    }
}
