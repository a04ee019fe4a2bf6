//! `RotationError`: the difference between an actual and a desired rotation, as a rotation vector.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Rotation, Slot, Spec, Step, UnitRule, Vector3,
    operands,
};
use crate::rotation;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationError",
        summary: "The rotation that leads from one rotation to another, as axis × angle in the outer axes.",
        undefined: "overflow: a quaternion that cannot be normalized",
        formula: "log(to from⁻¹); at 180° one of the two possible vectors is returned (Caccavale et al., Role of Euler parameters in robot control, Asian J. Control 1(1), 1999)",
        examples: &[Example::new(
            "oblique (scipy 1.17), and zero",
            "",
            "from | to | out\n\
             {quat: [0.18485641079320972, -0.323498718888117, 0.5083551296813268, 0.7763708832723447]} | {rpy: [0.3, -0.5, 1.2]} | [-0.13329337432887994, 0.36527084124707254, 0.22884581650653762]\n\
             {rpy: [0, 0, 1]} | {rpy: [0, 0, 1]} | [0, 0, 0]\n\
             null | {rpy: [0, 0, 1]} | null",
        )],
        inputs: &[
            Port::typed("from", Type::Rotation, "actual rotation, in A"),
            Port::typed("to", Type::Rotation, "desired rotation, in A"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Is(Type::Vector3),
            UnitRule::Is(Unit::RADIAN),
            "axis × angle in axes of A, length at most π",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationError>()],
);

operands! {
    struct RotationError { from: Slot<Rotation>, to: Slot<Rotation>, out: Slot<Vector3> }
}

impl Step for RotationError {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let rotations = frame.rotation(self.from).zip(frame.rotation(self.to));
        frame.put_composite(
            self.out,
            rotations.map(|(from, to)| rotation::error(from, to)),
        )
    }
}
