//! `RotationToMatrix`: the rotation matrix of a rotation.

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
        name: "RotationToMatrix",
        summary: "The rotation matrix of a rotation.",
        undefined: "overflow: a quaternion that cannot be normalized",
        formula: "Solà, arXiv:1711.02508, section 2",
        examples: &[Example::new(
            "a general rotation (scipy 1.17)",
            "",
            "in | out\n\
             {rpy: [0.3, -0.5, 1.2]} | [[0.31799884649448174, -0.9417497709439282, 0.10947192587708207], [0.8179412488450797, 0.2141223485536774, -0.533969786867767], [0.4794255386042029, 0.2593433800522307, 0.8383866435942033]]\n\
             null | null",
        )],
        inputs: &[Port::typed("in", Type::Rotation, "rotation of B in A")],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Matrix(3, 3)),
            UnitRule::Is(Unit::ONE),
            "rotation matrix by rows: its columns are the axes of B in A",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationToMatrix>()],
);

operands! {
    struct RotationToMatrix { input: Slot<Rotation>, out: Slot<[Real; 9]> }
}

impl Step for RotationToMatrix {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let matrix = frame.rotation(self.input).map(rotation::to_matrix);
        frame.put_composite(self.out, matrix.map(bytemuck::cast))
    }
}
