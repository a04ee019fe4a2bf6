//! `SplitVector`: the three numbers of a vector.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::types::{NULL_REAL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SplitVector",
        summary: "The three elements of a vector.",
        undefined: "overflow: an infinite input",
        examples: &[Example::new(
            "elements in order",
            "",
            "in | x | y | z\n\
             [1, -2, 3.5] | 1 | -2 | 3.5\n\
             null | null | null | null",
        )],
        inputs: &[Port::new(
            "in",
            PortType::Is(Type::Vector3),
            UnitRule::Var(0),
            "`[x y z]`",
        )],
        outputs: &[
            Port::real("x", UnitRule::Var(0), "element along x"),
            Port::real("y", UnitRule::Var(0), "element along y"),
            Port::real("z", UnitRule::Var(0), "element along z"),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<SplitVector>()],
);

operands! {
    struct SplitVector { input: Slot<Vector3>, x: Slot<Real>, y: Slot<Real>, z: Slot<Real> }
}

impl Step for SplitVector {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let SplitVector { x, y, z, .. } = self;
        let elements = frame.composite(self.input).unwrap_or([NULL_REAL; 3]);
        for (slot, element) in [x, y, z].into_iter().zip(elements) {
            frame.put(slot, element)?;
        }
        Some(())
    }
}
