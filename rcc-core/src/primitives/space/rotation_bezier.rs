//! `RotationBezier`: a smooth curve between two rotations with given angular velocities at its ends.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Example, Kernel, Port, PortType, Real, Rotation, Slot, Spec, Step, UnitRule,
    Vector3, operands,
};
use crate::types::Type;
use crate::unit::Unit;
use crate::{rotation, vector};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "RotationBezier",
        summary: "A cubic curve between two rotations, with given angular velocities at its ends.",
        undefined: "two rotations of the construction 180° apart; overflow: an infinite input, a quaternion that cannot be normalized, velocities too large for a number",
        formula: "de Casteljau with Slerp of from, exp(v₀/3) from, exp(-v₁/3) to, to (Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985)",
        examples: &[
            Example::new(
                "a uniform rotation about z is reproduced",
                "",
                "from | to | from_velocity | to_velocity | s | out\n\
             {rpy: [0, 0, 0]} | {rpy: [0, 0, 1.2]} | [0, 0, 1.2] | [0, 0, 1.2] | 0.25 | {rpy: [0, 0, 0.3]}\n\
             {rpy: [0, 0, 0]} | {rpy: [0, 0, 1.2]} | [0, 0, 1.2] | [0, 0, 1.2] | 0 | {rpy: [0, 0, 0]}\n\
             {rpy: [0, 0, 0]} | {rpy: [0, 0, 1.2]} | [0, 0, 1.2] | [0, 0, 1.2] | 1 | {rpy: [0, 0, 1.2]}",
            ),
            Example::new(
                "from rest to rest: fraction 3s² - 2s³ of the rotation",
                "",
                "from | to | from_velocity | to_velocity | s | out\n\
             {rpy: [0, 0, 0]} | {rpy: [0, 0, 1.2]} | [0, 0, 0] | [0, 0, 0] | 0.25 | {rpy: [0, 0, 0.1875]}\n\
             {rpy: [0, 0, 0]} | {rpy: [0, 0, 1.2]} | [0, 0, 0] | [0, 0, 0] | 0.5 | {rpy: [0, 0, 0.6]}\n\
             {rpy: [0, 0, 0]} | {rpy: [0, 0, 1.2]} | [0, 0, 0] | [0, 0, 0] | null | null",
            ),
        ],
        inputs: &[
            Port::typed("from", Type::Rotation, "rotation at s = 0, in A"),
            Port::typed("to", Type::Rotation, "rotation at s = 1, in A"),
            Port::new(
                "from_velocity",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::RADIAN),
                "rotation vector per unit of s at the start, axes of A",
            ),
            Port::new(
                "to_velocity",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::RADIAN),
                "rotation vector per unit of s at the end, axes of A",
            ),
            Port::real(
                "s",
                UnitRule::Is(Unit::ONE),
                "curve parameter, 0 to 1; outside, the curve is extrapolated",
            ),
        ],
        outputs: &[Port::typed("out", Type::Rotation, "rotation at s, in A")],
        ..Spec::PLAIN
    },
    &[Kernel::each::<RotationBezier>()],
);

operands! {
    struct RotationBezier {
        from: Slot<Rotation>, to: Slot<Rotation>, from_velocity: Slot<Vector3>, to_velocity: Slot<Vector3>,
        s: Slot<Real>, out: Slot<Rotation>,
    }
}

impl Step for RotationBezier {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let ends = frame.rotation(self.from).zip(frame.rotation(self.to));
        let velocities = frame
            .composite(self.from_velocity)
            .zip(frame.composite(self.to_velocity));
        let s = frame.get(self.s)?;
        let rotation = ends.zip(velocities).and_then(|((from, to), (start, end))| {
            let third = |velocity| rotation::exp(vector::scale(velocity, 1.0 / 3.0));
            let leaving = rotation::product(third(start), from);
            let arriving = rotation::product(rotation::inverse(third(end)), to);
            rotation::bezier([from, leaving, arriving, to], s)
        });
        frame.put_composite(self.out, rotation)
    }
}
