//! `Solve`: the solution of a system of linear equations.

use crate::frame::Frame;
use crate::linear::AugmentedMatrix;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Real, Slot, Spec, Step,
    UnitRule, fill_null, operands,
};
use crate::types::Type;

const SIDE: Dim = Dim::Small(0);
const VECTOR: PortType = PortType::Array(ElementType::Are(Type::Real), SIDE);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Solve",
        summary: "Solves a system of linear equations with a square matrix, at most 8×8.",
        null: "a null element gives null in every element",
        undefined: "a matrix that is singular within rounding; overflow",
        formula: "matrix · out = in; Gauss-Jordan with partial pivoting (Golub, Van Loan: Matrix Computations, 3.4); singular: a pivot ≤ n·ε·max|matrix|",
        inputs: &[
            Port::new(
                "matrix",
                PortType::Matrix(SIDE, SIDE),
                UnitRule::Var(0),
                "the matrix, square, at most 8×8",
            ),
            Port::new("in", VECTOR, UnitRule::Var(1), "right-hand side"),
        ],
        outputs: &[Port::new(
            "out",
            VECTOR,
            UnitRule::Quotient(1, 0),
            "the solution",
        )],
        examples: &[Example::new(
            "two equations",
            "",
            "matrix | in | out
             [[0.0, 2.0], [4.0, 0.0]] | [2.0, 8.0] | [2.0, 1.0]
             [[1.0, 2.0], [2.0, 4.0]] | [2.0, 8.0] | null",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Solve>()],
);

operands! {
    struct Solve { matrix: Slot<Real>, input: Slot<Real>, out: Slot<Real>, side: u32 }
}

impl Step for Solve {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Some(tableau) = self.solved(frame) else {
            return fill_null(frame, self.out, self.side);
        };
        for row in 0..self.side {
            frame.put(self.out + row, tableau.get(row, 0)?)?;
        }
        Some(())
    }
}

impl Solve {
    fn solved(self, frame: &Frame<'_>) -> Option<AugmentedMatrix<9>> {
        let mut tableau = AugmentedMatrix::read(frame, self.matrix, self.side)?;
        tableau.fill(|row, _| {
            let value = frame.get(self.input + row)?;
            value.is_finite().then_some(value)
        })?;
        tableau.reduce(tableau.least_pivot())?;
        Some(tableau)
    }
}
