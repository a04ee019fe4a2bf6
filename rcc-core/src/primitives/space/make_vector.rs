//! `MakeVector`: a vector from three numbers of the same unit.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "MakeVector",
        summary: "A vector from its three elements.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "elements in order",
            "",
            "x | y | z | out\n\
             1 | -2 | 3.5 | [1, -2, 3.5]\n\
             1 | null | 3.5 | null",
        )],
        inputs: &[
            Port::real("x", UnitRule::Var(0), "element along x"),
            Port::real("y", UnitRule::Var(0), "element along y"),
            Port::real("z", UnitRule::Var(0), "element along z"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Var(0),
            "`[x y z]`",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<MakeVector>()],
);

operands! {
    struct MakeVector { x: Slot<Real>, y: Slot<Real>, z: Slot<Real>, out: Slot<Vector3> }
}

impl Step for MakeVector {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let vector = [frame.get(self.x)?, frame.get(self.y)?, frame.get(self.z)?];
        frame.put_composite(self.out, Some(vector))
    }
}
