//! `RotationFromMatrix`: the rotation nearest to an approximate rotation matrix.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Rotation, Slot, Spec, Step, UnitRule,
    operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationFromMatrix",
        summary: "The rotation nearest to a 3 × 3 matrix, which is orthonormalized first.",
        undefined: "a matrix with an element of |MᵀM - 1| above 1e-3; a reflection; overflow: an infinite input",
        formula: "three steps M ← M (3 - MᵀM) / 2 (Björck and Bowie, SIAM J. Numer. Anal. 8(2), 1971), then Shepperd, J. Guidance and Control 1(3), 1978",
        examples: &[Example::new(
            "a general, a rounded, and an invalid matrix (scipy 1.17)",
            "",
            "in | out\n\
             [[0.31799884649448174, -0.9417497709439282, 0.10947192587708207], [0.8179412488450797, 0.2141223485536774, -0.533969786867767], [0.4794255386042029, 0.2593433800522307, 0.8383866435942033]] | {quat: [0.25762853798958335, -0.12014247631977643, 0.5714598517275828, 0.7698226806613264]}\n\
             [[0, -1.0001, 0], [1.0001, 0, 0], [0, 0, 1]] | {rpy: [0, 0, deg(90)]}\n\
             [[1, 0, 0], [0, 1, 0], [0, 0, -1]] | null\n\
             [[2, 0, 0], [0, 2, 0], [0, 0, 2]] | null\n\
             null | null",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Is(Type::Matrix(3, 3)),
            UnitRule::Is(Unit::ONE),
            "rotation matrix by rows: its columns are the axes of B in A",
        )],
        outputs: &[Port::typed(
            "out",
            Type::Rotation,
            "rotation of B in A, w ≥ 0",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromMatrix>()],
);

operands! {
    struct RotationFromMatrix { input: Slot<[Real; 9]>, out: Slot<Rotation> }
}

impl Step for RotationFromMatrix {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let matrix = frame.composite::<9>(self.input).map(bytemuck::cast);
        frame.put_composite(self.out, matrix.and_then(|m| rotation::from_matrix(&m)))
    }
}
