//! `Transpose`: the transpose of a matrix.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule,
    operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Transpose",
        summary: "The transpose of a matrix.",
        null: "null is passed through, element by element",
        inputs: &[Port::new(
            "in",
            PortType::Matrix(Dim::Var(0), Dim::Var(1)),
            UnitRule::Var(0),
            "a matrix",
        )],
        outputs: &[Port::new(
            "out",
            PortType::Matrix(Dim::Var(1), Dim::Var(0)),
            UnitRule::Var(0),
            "out[i,j] = in[j,i]",
        )],
        examples: &[Example::new(
            "2×3",
            "",
            "in | out
             [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]] | [[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Transpose>()],
);

operands! {
    struct Transpose { input: Slot<Real>, out: Slot<Real>, rows: u32, columns: u32 }
}

impl Step for Transpose {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Transpose { rows, columns, .. } = self;
        for row in 0..rows {
            for column in 0..columns {
                let value = frame.get(self.input + row * columns + column)?;
                frame.put(self.out + column * rows + row, value)?;
            }
        }
        Some(())
    }
}
