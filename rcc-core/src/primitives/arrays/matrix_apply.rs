//! `MatrixApply`: a matrix times a column vector.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Real, Slot, Spec, Step,
    UnitRule, operands,
};
use crate::types::Type;

const ROWS: Dim = Dim::Var(0);
const COLUMNS: Dim = Dim::Var(1);
const REALS: ElementType = ElementType::Are(Type::Real);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MatrixApply",
        summary: "The product of a matrix and an array as a column vector.",
        null: "a null element gives null in every element that depends on it",
        undefined: "overflow",
        formula: "out[i] = matrix[i,0]·in[0] + … + matrix[i,n-1]·in[n-1]",
        inputs: &[
            Port::new(
                "matrix",
                PortType::Matrix(ROWS, COLUMNS),
                UnitRule::Var(0),
                "the matrix",
            ),
            Port::new(
                "in",
                PortType::Array(REALS, COLUMNS),
                UnitRule::Var(1),
                "vector, as long as the matrix has columns",
            ),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Array(REALS, ROWS),
            UnitRule::Product(0, 1),
            "product, as long as the matrix has rows",
        )],
        examples: &[Example::new(
            "2×3",
            "",
            "matrix | in | out
             [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]] | [1.0, 0.0, -1.0] | [-2.0, -2.0]",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<MatrixApply>()],
);

operands! {
    struct MatrixApply { matrix: Slot<Real>, input: Slot<Real>, out: Slot<Real>, rows: u32, columns: u32 }
}

impl Step for MatrixApply {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let MatrixApply { rows, columns, .. } = self;
        for row in 0..rows {
            let mut sum = 0.0;
            for column in 0..columns {
                let element = frame.get(self.matrix + row * columns + column)?;
                sum += element * frame.get(self.input + column)?;
            }
            frame.put(self.out + row, sum)?;
        }
        Some(())
    }
}
