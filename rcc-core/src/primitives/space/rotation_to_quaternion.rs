//! `RotationToQuaternion`: the four elements of a rotation's quaternion.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, Real, Rotation, Slot, Spec, Step, UnitRule, operands,
};
use crate::rotation;
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;

/// 1 plus rounding.
const BOUND: f64 = 1.0 + 1e-14;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationToQuaternion",
        summary: "The quaternion of a rotation, with w ≥ 0.",
        undefined: "overflow: a quaternion that cannot be normalized",
        formula: "Hamilton, ij = k; if w = 0, the last nonzero element is positive",
        examples: &[Example::new(
            "the sign",
            "",
            "in | x | y | z | w\n\
             {quat: [0, 0.6, 0, 0.8]} | 0 | 0.6 | 0 | 0.8\n\
             {quat: [0, 0.6, 0, -0.8]} | 0 | -0.6 | 0 | 0.8\n\
             null | null | null | null | null",
        )],
        inputs: &[Port::typed("in", Type::Rotation, "rotation of B in A")],
        outputs: &[
            Port::real("x", UnitRule::Is(Unit::ONE), "factor of i").within(-BOUND, BOUND),
            Port::real("y", UnitRule::Is(Unit::ONE), "factor of j").within(-BOUND, BOUND),
            Port::real("z", UnitRule::Is(Unit::ONE), "factor of k").within(-BOUND, BOUND),
            Port::real("w", UnitRule::Is(Unit::ONE), "real part").within(0.0, BOUND),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationToQuaternion>()],
);

operands! {
    struct RotationToQuaternion { input: Slot<Rotation>, x: Slot<Real>, y: Slot<Real>, z: Slot<Real>, w: Slot<Real> }
}

impl Step for RotationToQuaternion {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let RotationToQuaternion { x, y, z, w, .. } = self;
        let quaternion = frame.rotation(self.input).map(rotation::canonical);
        let elements = quaternion.unwrap_or([NULL_REAL; 4]);
        for (slot, element) in [x, y, z, w].into_iter().zip(elements) {
            frame.put(slot, element)?;
        }
        Some(())
    }
}
