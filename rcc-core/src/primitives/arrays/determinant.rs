//! `Determinant`: computed by Gaussian elimination.

use crate::frame::Frame;
use crate::linear::AugmentedMatrix;
use crate::primitive::{
    CatalogueEntry, Dim, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule,
    operands,
};
use crate::types::NULL_REAL;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Determinant",
        summary: "The determinant of a square matrix of dimensionless numbers, at most 8×8.",
        null: "a null element gives null",
        undefined: "overflow",
        formula: "the product of the pivots; Gauss-Jordan with partial pivoting (Golub, Van Loan: Matrix Computations, 3.4)",
        inputs: &[Port::new(
            "in",
            PortType::Matrix(Dim::Small(0), Dim::Small(0)),
            UnitRule::Is(Unit::ONE),
            "the matrix, square, at most 8×8",
        )],
        outputs: &[Port::real(
            "out",
            UnitRule::Is(Unit::ONE),
            "its determinant",
        )],
        examples: &[Example::new(
            "3×3",
            "",
            "in | out
             [[2.0, 0.0, 1.0], [1.0, 3.0, 2.0], [1.0, 1.0, 1.0]] | 0.0
             [[2.0, 0.0, 1.0], [1.0, 3.0, 2.0], [1.0, 1.0, 2.0]] | 6.0",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Determinant>()],
);

operands! {
    struct Determinant { input: Slot<Real>, out: Slot<Real>, side: u32 }
}

impl Step for Determinant {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Some(mut tableau) = AugmentedMatrix::<8>::read(frame, self.input, self.side) else {
            return frame.put(self.out, NULL_REAL);
        };
        // Only a zero pivot ends the elimination early.
        let determinant = tableau.reduce(0.0).unwrap_or(0.0);
        frame.put(self.out, determinant)
    }
}
