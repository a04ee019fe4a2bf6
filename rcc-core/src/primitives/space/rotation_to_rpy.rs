//! `RotationToRpy`: roll, pitch and yaw of a rotation.

use core::f64::consts::{FRAC_PI_2, PI};

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Rotation, Slot, Spec, Step, UnitRule, operands,
};
use crate::rotation;
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationToRpy",
        summary: "Roll, pitch and yaw of a rotation; at the gimbal lock, a pitch of ±90°, yaw is 0.",
        undefined: "overflow: a quaternion that cannot be normalized",
        formula: "Rz(yaw) Ry(pitch) Rx(roll) = R, by half sums and differences (Bernardes and Viollet, PLoS ONE 17(11), 2022); within 1e-10 rad of the gimbal lock yaw is 0",
        examples: &[Example::new(
            "the angles are recovered, and the gimbal lock",
            "",
            "in | roll | pitch | yaw\n\
             {rpy: [0.3, -0.5, 1.2]} | 0.3 | -0.5 | 1.2\n\
             {rpy: [3, 1.5, -3]} | 3 | 1.5 | -3\n\
             {rpy: [0.3, deg(90), 0.9]} | -0.6 | deg(90) | 0\n\
             null | null | null | null",
        )],
        inputs: &[Port::typed("in", Type::Rotation, "rotation of B in A")],
        outputs: &[
            Port::real("roll", UnitRule::Is(Unit::RADIAN), "about x, first").within(-PI, PI),
            Port::real("pitch", UnitRule::Is(Unit::RADIAN), "about the fixed y")
                .within(-FRAC_PI_2, FRAC_PI_2),
            Port::real("yaw", UnitRule::Is(Unit::RADIAN), "about the fixed z, last")
                .within(-PI, PI),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationToRpy>()],
);

operands! {
    struct RotationToRpy { input: Slot<Rotation>, roll: Slot<Real>, pitch: Slot<Real>, yaw: Slot<Real> }
}

impl Step for RotationToRpy {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let RotationToRpy {
            roll, pitch, yaw, ..
        } = self;
        let angles = frame.rotation(self.input).map(rotation::to_rpy);
        for (slot, angle) in [roll, pitch, yaw]
            .into_iter()
            .zip(angles.unwrap_or([NULL_REAL; 3]))
        {
            frame.put(slot, angle)?;
        }
        Some(())
    }
}
