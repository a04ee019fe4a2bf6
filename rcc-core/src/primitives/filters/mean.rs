//! `Mean`: the arithmetic mean of the elements of an array: their sum, from the first to the last, divided by their
//! number.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Real, Slot, Spec, Step,
    UnitRule, operands,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Mean",
        summary: "The arithmetic mean of the elements of an array.",
        null: "a null element gives null",
        undefined: "overflow",
        formula: "(in[0] + … + in[n-1]) / n",
        inputs: &[Port::new(
            "in",
            PortType::Array(ElementType::Are(Type::Real), Dim::Var(0)),
            UnitRule::Var(0),
            "an array of numbers",
        )],
        outputs: &[Port::real("out", UnitRule::Var(0), "the mean")],
        examples: &[Example::new(
            "an array with a null element",
            "",
            "in | out
             [1.0, 2.0, 6.0] | 3.0
             [1.0, null, 6.0] | null",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Mean>()],
);

operands! {
    struct Mean { input: Slot<Real>, out: Slot<Real>, length: u32 }
}

impl Step for Mean {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Mean { length, .. } = self;
        let mut sum = 0.0;
        for i in 0..length {
            sum += frame.get(self.input + i)?;
        }
        frame.put(self.out, sum / f64::from(length))
    }
}
