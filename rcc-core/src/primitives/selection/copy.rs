//! `Copy`: out = in. The loader inserts it where values must be contiguous, for a list of links.

use crate::frame::Frame;
use crate::primitive::{
    Bool, ByElement, CatalogueEntry, Element, Example, Int, Kernel, Port, PortType, Real, Slot,
    Spec, Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Copy",
        summary: "Passes its input through, of any type: a list of links becomes one named value.",
        null: "null is passed through, element by element",
        inputs: &[Port::new(
            "in",
            PortType::Any,
            UnitRule::Var(0),
            "any value",
        )],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "the same",
        )],
        examples: &[Example::new(
            "any type",
            "",
            "in | out\n [true, false] | [true, false]",
        )],
        ..Spec::PLAIN
    },
    &[
        Kernel::scalar::<Copy<Real>>(),
        Kernel::by_element::<Copy<Real>>(),
        Kernel::scalar::<Copy<Bool>>(),
        Kernel::by_element::<Copy<Bool>>(),
        Kernel::scalar::<Copy<Int>>(),
        Kernel::by_element::<Copy<Int>>(),
    ],
);

operands! {
    struct Copy<E> { input: Slot<E>, out: Slot<E> }
}

impl<E: Element> Step for Copy<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        frame.put(self.out, value)
    }
}

impl<E: Element> ByElement for Copy<E>
where
    Copy<E>: Step,
{
    #[inline(always)]
    fn element(self, i: u32) -> Self {
        Copy {
            input: self.input + i,
            out: self.out + i,
        }
    }
}
