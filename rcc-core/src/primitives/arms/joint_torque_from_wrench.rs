//! `JointTorqueFromWrench`: the static joint torques that balance a force and torque at the flange.

use crate::frame::Frame;
use crate::joints::JOINTS_MAX;
use crate::primitive::{
    CatalogueEntry, Device, Example, Kernel, Parameter, Port, PortType, Real, Slot, Spatial, Spec,
    Step, UnitRule, operands,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointTorqueFromWrench",
        summary: "The static joint torques for a wrench that the flange exerts, at joint positions.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "J(q)ᵀ wrench, by virtual work (Siciliano et al., Robotics, 2009, section 3.8)",
        examples: &[
            Example::new(
                "10 N along x at the top of the stretched arm",
                "{device: lwr}",
                "joints | wrench | torque\n\
             [0, 0, 0, 0, 0, 0, 0] | [10, 0, 0, 0, 0, 0] | [0, -8.68, 0, 4.68, 0, -0.78, 0]\n\
             [0, 0, 0, 0, 0, 0, 0] | [0, 0, 10, 0, 0, 2] | [2, 0, 2, 0, 2, 0, 2]\n\
             [0, 0, 0, 0, 0, 0, 0] | null | null",
            ),
            Example::new(
                "of the LWR 4+ (Jacobian of pinocchio 4.1.0, numpy)",
                "{device: lwr}",
                "joints | wrench | torque\n\
             [-1.385834571490251, -1.508934551650702, -0.13127889865271847, -0.3481329987433579, -1.586961919235636, -0.5549652320396312, -0.7928431630588717] | [10.0, -5.0, 2.0, 0.3, 0.1, -0.2] | [7.218124246266613, -0.10559049586853628, -1.515860075066939, 0.2382635122801121, -0.1197085222882509, 0.7544281530855581, -0.267270657372136]",
            ),
        ],
        inputs: &[
            Port::new(
                "joints",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint positions, A1 first",
            ),
            Port::typed(
                "wrench",
                Type::Wrench,
                "exerted by the flange, axes of the base, reference point the origin of the flange",
            ),
        ],
        outputs: &[Port::new(
            "torque",
            PortType::Joints,
            UnitRule::Is(Unit::NEWTON_METRE),
            "joint torques, A1 first",
        )],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointTorqueFromWrench>()],
);

operands! {
    struct JointTorqueFromWrench {
        joints: Slot<Real>, wrench: Slot<Spatial>, torque: Slot<Real>, device: Device, width: u32,
    }
}

impl Step for JointTorqueFromWrench {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let there = frame.arm_at(self.device, self.joints, self.width);
        let wrench: Option<[f64; 6]> = frame.composite(self.wrench);
        let torques = there.zip(wrench).map(|((arm, joints), wrench)| {
            let mut torques = [0.0; JOINTS_MAX];
            for (row, force) in arm.jacobian(&joints).iter().zip(wrench) {
                for (torque, arm) in torques.iter_mut().zip(row) {
                    *torque += arm * force;
                }
            }
            torques
        });
        let finite = torques.filter(|torques| torques.iter().all(|torque| torque.is_finite()));
        frame.put_joints(self.torque, self.width, finite.as_ref())
    }
}
