//! `InverseVelocityKinematics`: the smallest joint velocities that give the flange a twist.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Example, Kernel, Parameter, Port, PortType, Real, Slot, Spatial, Spec,
    Step, UnitRule, operands,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "InverseVelocityKinematics",
summary: "The smallest joint velocities for a twist of the flange; damped near singularities.",
null: "a null input gives null outputs, and so does a singularity with a damping of 0",
undefined: "damping = 0; overflow: an infinite input, a result out of range",
formula: "Jᵀ (J Jᵀ + λ² 1)⁻¹ twist with 1 m weighing as much as 1 rad (Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control 108(3), 1986; Wampler, IEEE T-SMC 16(1), 1986)",
examples: &[Example::new("a zero twist, and a singularity", "{device: lwr, damping: 0.05}", "joints | twist | velocity\n\
             [0, 0.5, 0, 1, 0, 0.3, 0] | [0, 0, 0, 0, 0, 0] | [0, 0, 0, 0, 0, 0, 0]\n\
             [0, 0, 0, 0, 0, 0, 0] | [0, 0, 1, 0, 0, 0] | [0, 0, 0, 0, 0, 0, 0]\n\
             null | [0, 0, 0, 0, 0, 0] | null"),
Example::new("of the LWR 4+ (Jacobian of pinocchio 4.1.0, numpy)", "{device: lwr, damping: 0.05}", "joints | twist | velocity\n\
             [-1.385834571490251, -1.508934551650702, -0.13127889865271847, -0.3481329987433579, -1.586961919235636, -0.5549652320396312, -0.7928431630588717] | [0.1, 0.2, -0.3, 0.5, -0.4, 0.6] | [0.22162972128620018, -1.039124483043584, 0.9286712906949343, -1.5184108011977129, 1.0386546648116401, 0.3974710228394357, -1.587051089852866]"),],
inputs: &[Port::new("joints", PortType::Joints, UnitRule::Joint(0), "joint positions, A1 first"), Port::typed("twist", Type::Twist, "desired twist of the flange, axes of the base, reference point the origin of the flange")],
outputs: &[Port::new("velocity", PortType::Joints, UnitRule::Joint(1), "joint velocities, A1 first; not limited here: the guard checks limits")],
parameters: &[Parameter::arm(), Parameter::real("damping", UnitRule::Is(Unit::ONE), "λ: 0 is exact but unbounded near singularities; 0.05 follows within 1 % where the smallest singular value is above 0.5, and no joint exceeds 1/(2 λ) times the twist").at_least(0.0)],
        ..Spec::PLAIN
    },
    &[Kernel::each::<InverseVelocityKinematics>()],
);

operands! {
    struct InverseVelocityKinematics {
        joints: Slot<Real>, twist: Slot<Spatial>, velocity: Slot<Real>, device: Device, damping: Slot<Real>,
        width: u32,
    }
}

impl Step for InverseVelocityKinematics {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let damping = frame.get(self.damping)?;
        let there = frame.arm_at(self.device, self.joints, self.width);
        let rates = there
            .zip(frame.composite(self.twist))
            .and_then(|((arm, joints), twist)| arm.joint_velocities(&joints, &twist, damping));
        frame.put_joints(self.velocity, self.width, rates.as_ref())
    }
}
