//! `Scale`: out = in · factor, each element rounded once; an `Int` overflow gives null.

use super::multiply::Multiply;
use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Element, Example, Int, Kernel, Operation, Port, PortType, Real, Slot, Spec,
    Step, UnitRule, each_pair, operands,
};
use crate::types::Store;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Scale",
        summary: "A number, vector, array or matrix times a number; its unit is the product of theirs.",
        null: "a null element gives a null element, a null factor gives null in all elements",
        undefined: "overflow",
        inputs: &[
            Port::linear("in", UnitRule::Var(0), "value to scale"),
            Port::new("factor", PortType::Part, UnitRule::Var(1), "factor"),
        ],
        outputs: &[Port::linear("out", UnitRule::Product(0, 1), "in · factor")],
        examples: &[
            Example::new(
                "an array",
                "",
                "in | factor | out
                 [1.0, -2.0, 0.5] | 2.0 | [2.0, -4.0, 1.0]
                 [1.0, -2.0, 0.5] | null | null",
            ),
            Example::new("a number", "", "in | factor | out\n 3.0 | 0.5 | 1.5"),
        ],
        ..Spec::PLAIN
    },
    &[
        Kernel::single(Store::Real, each_pair::<Real, Multiply>),
        Kernel::each::<Scale<Real>>(),
        Kernel::single(Store::Int, each_pair::<Int, Multiply>),
        Kernel::each::<Scale<Int>>(),
    ],
);

operands! {
    struct Scale<E> { input: Slot<E>, factor: Slot<E>, out: Slot<E>, width: u32 }
}

impl<E: Element> Step for Scale<E>
where
    Multiply: Operation<E>,
{
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let factor = frame.get(self.factor)?;
        for i in 0..self.width {
            let value = frame.get(self.input + i)?;
            frame.put(self.out + i, Multiply::apply(value, factor))?;
        }
        Some(())
    }
}
