//! `MatrixMultiply`: the product of two matrices, with each element summed from the first term to the last.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule,
    operands,
};

const ROWS: Dim = Dim::Var(0);
const INNER: Dim = Dim::Var(1);
const COLUMNS: Dim = Dim::Var(2);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MatrixMultiply",
        summary: "The product of two matrices.",
        null: "a null element gives null in every element that depends on it",
        undefined: "overflow",
        formula: "out[i,j] = a[i,0]·b[0,j] + … + a[i,m-1]·b[m-1,j]",
        inputs: &[
            Port::new(
                "a",
                PortType::Matrix(ROWS, INNER),
                UnitRule::Var(0),
                "left factor",
            ),
            Port::new(
                "b",
                PortType::Matrix(INNER, COLUMNS),
                UnitRule::Var(1),
                "right factor, with as many rows as the left one has columns",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Matrix(ROWS, COLUMNS),
            UnitRule::Product(0, 1),
            "a · b",
        )],
        examples: &[Example::new(
            "2×3 times 3×1",
            "",
            "a | b | out
             [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]] | [[1.0], [0.0], [-1.0]] | [[-2.0], [-2.0]]",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<MatrixMultiply>()],
);

operands! {
    struct MatrixMultiply { a: Slot<Real>, b: Slot<Real>, out: Slot<Real>, rows: u32, inner: u32, columns: u32 }
}

impl Step for MatrixMultiply {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let MatrixMultiply {
            rows,
            inner,
            columns,
            ..
        } = self;
        for row in 0..rows {
            for column in 0..columns {
                let mut sum = 0.0;
                for i in 0..inner {
                    let left = frame.get(self.a + row * inner + i)?;
                    sum += left * frame.get(self.b + i * columns + column)?;
                }
                frame.put(self.out + row * columns + column, sum)?;
            }
        }
        Some(())
    }
}
