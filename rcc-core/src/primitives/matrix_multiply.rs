//! `MatrixMultiply`: the product of two matrices, with each element summed from the first term to the last.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, Example, Kernel, Port, PortType, Spec, UnitRule, each,
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out, rows, inner, columns]: [u32; 6]) -> Option<()> {
    for row in 0..rows {
        for column in 0..columns {
            let mut sum = 0.0;
            for i in 0..inner {
                let left = frame.get_real(a + row * inner + i)?;
                sum += left * frame.get_real(b + i * columns + column)?;
            }
            frame.put_real(out + row * columns + column, sum)?;
        }
    }
    Some(())
}
