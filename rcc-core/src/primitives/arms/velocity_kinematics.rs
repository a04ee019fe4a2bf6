//! `VelocityKinematics`: the twist of an arm's flange for joint velocities.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Example, Kernel, Parameter, Port, PortType, Real, Slot, Spatial, Spec,
    Step, UnitRule, operands,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "VelocityKinematics",
        summary: "The twist of the flange for joint velocities at joint positions.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "J(q) q̇ with the geometric Jacobian (Siciliano et al., Robotics, 2009, section 3.1)",
        examples: &[
            Example::new(
                "stretched up, joint 2 swings the flange about the shoulder, 0.868 m below it",
                "{device: lwr}",
                "joints | velocity | twist\n\
             [0, 0, 0, 0, 0, 0, 0] | [0, 1, 0, 0, 0, 0, 0] | [-0.868, 0, 0, 0, -1, 0]\n\
             [0, 0, 0, 0, 0, 0, 0] | [1, 0, 0, 0, 0, 0, -1] | [0, 0, 0, 0, 0, 0]\n\
             null | [1, 0, 0, 0, 0, 0, 0] | null",
            ),
            Example::new(
                "of the LWR 4+ (pinocchio 4.1.0)",
                "{device: lwr}",
                "joints | velocity | twist\n\
             [-1.385834571490251, -1.508934551650702, -0.13127889865271847, -0.3481329987433579, -1.586961919235636, -0.5549652320396312, -0.7928431630588717] | [-1.505192072173278, 0.5928773396056899, 1.108901277230348, 1.8820666550084266, 1.7936278465508573, -0.9065393990588873, -1.8823615895073087] | [-1.5241294725505907, -0.47127116426389704, -0.3909802152753552, 2.408374128828993, -1.2533569919654943, -2.5720723282534133]",
            ),
        ],
        inputs: &[
            Port::new(
                "joints",
                PortType::Joints,
                UnitRule::Joint(0),
                "joint positions, A1 first",
            ),
            Port::new(
                "velocity",
                PortType::Joints,
                UnitRule::Joint(1),
                "joint velocities, A1 first",
            ),
        ],
        outputs: &[Port::typed(
            "twist",
            Type::Twist,
            "twist of the flange, axes of the base, reference point the origin of the flange",
        )],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<VelocityKinematics>()],
);

operands! {
    struct VelocityKinematics {
        joints: Slot<Real>, velocity: Slot<Real>, twist: Slot<Spatial>, device: Device, width: u32,
    }
}

impl Step for VelocityKinematics {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let there = frame.arm_at(self.device, self.joints, self.width);
        let velocity = frame.joints(self.velocity, self.width);
        let moving = there.zip(velocity).map(|((arm, joints), velocity)| {
            let jacobian = arm.jacobian(&joints);
            jacobian.map(|row| row.iter().zip(velocity).map(|(j, v)| j * v).sum())
        });
        frame.put_composite(self.twist, moving)
    }
}
