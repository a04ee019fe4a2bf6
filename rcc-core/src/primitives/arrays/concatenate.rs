//! `Concatenate`: joins two arrays. Single values are joined by a list of links: `[a.out, b.out]`.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Dim, Element, ElementType, Example, Int, Kernel, Port, PortType, Real,
    Slot, Spec, Step, UnitRule, copy, operands,
};

const fn array(length: Dim) -> PortType {
    PortType::Array(ElementType::Open, length)
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Concatenate",
        summary: "Joins two arrays, the second after the first.",
        null: "null is passed through, element by element",
        inputs: &[
            Port::new(
                "a",
                array(Dim::Var(0)),
                UnitRule::Var(0),
                "the first elements",
            ),
            Port::new(
                "b",
                array(Dim::Var(1)),
                UnitRule::Var(0),
                "the last elements",
            ),
        ],
        outputs: &[Port::new(
            "out",
            array(Dim::Sum(0, 1)),
            UnitRule::Var(0),
            "all elements",
        )],
        examples: &[Example::new(
            "arrays of different lengths",
            "",
            "a | b | out\n [1.0, 2.0] | [3.0, 4.0, 5.0] | [1.0, 2.0, 3.0, 4.0, 5.0]",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::each::<Concatenate<Real>>(),
        Kernel::each::<Concatenate<Bool>>(),
        Kernel::each::<Concatenate<Int>>(),
    ],
);

operands! {
    struct Concatenate<E> { a: Slot<E>, b: Slot<E>, out: Slot<E>, first: u32, second: u32 }
}

impl<E: Element> Step for Concatenate<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        copy(frame, self.a, self.out, self.first)?;
        copy(frame, self.b, self.out + self.first, self.second)
    }
}
