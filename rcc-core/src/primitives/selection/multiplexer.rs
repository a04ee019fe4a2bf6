//! `Multiplexer`: selects one of any number of values of the same type, by an index.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Dim, Element, Int, Kernel, NullRule, Port, PortType, Real, Slot, Spec,
    Step, UnitRule, copy, fill_null, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Multiplexer",
        summary: "Selects one of a list of values of any type, by an index.",
        null: "a null index gives null; among the values, only the selected one matters",
        null_rule: NullRule::FirstAndAnyKnown,
        undefined: "index < 0 or index ≥ the number of values",
        inputs: &[
            Port::int("index", "index of the value, from 0"),
            Port::new(
                "in",
                PortType::Many(Dim::Var(0)),
                UnitRule::Var(0),
                "the values, as a list of links and constants: `[a.pose, b.pose]`",
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
        Kernel::each::<Multiplexer<Real>>(),
        Kernel::each::<Multiplexer<Bool>>(),
        Kernel::each::<Multiplexer<Int>>(),
    ],
);

operands! {
    struct Multiplexer<E> { index: Slot<Int>, input: Slot<E>, out: Slot<E>, width: u32, count: u32 }
}

impl<E: Element> Step for Multiplexer<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        // A null index is negative.
        match u32::try_from(frame.get(self.index)?) {
            Ok(index) if index < self.count => {
                let input = self.input + index * self.width;
                copy(frame, input, self.out, self.width)
            }
            _ => fill_null(frame, self.out, self.width),
        }
    }
}
