//! `Inverse`: the inverse of a matrix. To solve equations, `Solve` is cheaper and more accurate.

use crate::frame::Frame;
use crate::linear::AugmentedMatrix;
use crate::primitive::{
    CatalogueEntry, Dim, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule,
    fill_null, operands,
};
use crate::unit::Unit;

const SQUARE: PortType = PortType::Matrix(Dim::Small(0), Dim::Small(0));

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Inverse",
        summary: "The inverse of a square matrix of dimensionless numbers, at most 8×8.",
        null: "a null element gives null in every element",
        undefined: "a matrix that is singular within rounding; overflow",
        formula: "in · out = 1; Gauss-Jordan with partial pivoting (Golub, Van Loan: Matrix Computations, 3.4); singular: a pivot ≤ n·ε·max|in|",
        inputs: &[Port::new(
            "in",
            SQUARE,
            UnitRule::Is(Unit::ONE),
            "the matrix, square, at most 8×8",
        )],
        outputs: &[Port::new(
            "out",
            SQUARE,
            UnitRule::Is(Unit::ONE),
            "inverse matrix",
        )],
        examples: &[Example::new(
            "2×2",
            "",
            "in | out
             [[0.0, 2.0], [4.0, 0.0]] | [[0.0, 0.25], [0.5, 0.0]]
             [[1.0, 2.0], [2.0, 4.0]] | null",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Inverse>()],
);

operands! {
    struct Inverse { input: Slot<Real>, out: Slot<Real>, side: u32 }
}

impl Step for Inverse {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let side = self.side;
        let Some(tableau) = inverted(frame, self.input, side) else {
            return fill_null(frame, self.out, side.saturating_mul(side));
        };
        for row in 0..side {
            for column in 0..side {
                frame.put(self.out + row * side + column, tableau.get(row, column)?)?;
            }
        }
        Some(())
    }
}

fn inverted(frame: &Frame<'_>, input: Slot<Real>, side: u32) -> Option<AugmentedMatrix<16>> {
    let mut tableau = AugmentedMatrix::read(frame, input, side)?;
    tableau.fill(|row, column| Some(if row == column { 1.0 } else { 0.0 }))?;
    tableau.reduce(tableau.least_pivot())?;
    Some(tableau)
}
