//! `RotationFromRpy`: a rotation from roll, pitch and yaw.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Rotation, Slot, Spec, Step, UnitRule, operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationFromRpy",
        summary: "A rotation from roll, pitch and yaw about the fixed axes x, y and z, in this order.",
        undefined: "overflow: an infinite input",
        formula: "R = Rz(yaw) Ry(pitch) Rx(roll); the same as A = yaw, B = pitch, C = roll about moving axes z, y, x (KUKA)",
        examples: &[Example::new(
            "one axis, and all axes (scipy 1.17)",
            "",
            "roll | pitch | yaw | out\n\
             0 | 0 | 0 | {quat: [0, 0, 0, 1]}\n\
             deg(180) | 0 | 0 | {quat: [1, 0, 0, 0]}\n\
             0.3 | -0.5 | 1.2 | {quat: [0.25762853798958335, -0.12014247631977643, 0.5714598517275828, 0.7698226806613264]}\n\
             0.3 | null | 1.2 | null",
        )],
        inputs: &[
            Port::real("roll", UnitRule::Is(Unit::RADIAN), "about x, first"),
            Port::real("pitch", UnitRule::Is(Unit::RADIAN), "about the fixed y"),
            Port::real("yaw", UnitRule::Is(Unit::RADIAN), "about the fixed z, last"),
        ],
        outputs: &[Port::typed("out", Type::Rotation, "rotation of B in A")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationFromRpy>()],
);

operands! {
    struct RotationFromRpy { roll: Slot<Real>, pitch: Slot<Real>, yaw: Slot<Real>, out: Slot<Rotation> }
}

impl Step for RotationFromRpy {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let angles = [
            frame.get(self.roll)?,
            frame.get(self.pitch)?,
            frame.get(self.yaw)?,
        ];
        let rotation = rotation::from_rpy(angles);
        frame.put_composite(self.out, Some(rotation))
    }
}
