//! `Solve`: the solution of a system of linear equations.

use crate::frame::Frame;
use crate::linear::AugmentedMatrix;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Port, PortType, Spec, UnitRule, each,
    fill_null,
};
use crate::types::{Store, Type};

const SIDE: Dim = Dim::Small(0);
const VECTOR: PortType = PortType::Array(ElementType::Are(Type::Real), SIDE);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Solve",
        summary: "Solves a system of linear equations with a square matrix, at most 8×8.",
        null: "a null element gives null in every element",
        undefined: "a matrix that is singular within rounding",
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline]
fn step(frame: &mut Frame<'_>, [matrix, input, out, side]: [u32; 4]) -> Option<()> {
    let Some(tableau) = solved(frame, matrix, input, side) else {
        return fill_null(frame, Store::Real, out, side);
    };
    for row in 0..side {
        frame.put_real(out + row, tableau.get(row, 0)?)?;
    }
    Some(())
}

fn solved(frame: &Frame<'_>, matrix: u32, input: u32, side: u32) -> Option<AugmentedMatrix<9>> {
    let mut tableau = AugmentedMatrix::read(frame, matrix, side)?;
    tableau.fill(|row, _| {
        frame
            .get_real(input + row)
            .filter(|value| value.is_finite())
    })?;
    tableau.reduce(tableau.least_pivot())?;
    Some(tableau)
}
