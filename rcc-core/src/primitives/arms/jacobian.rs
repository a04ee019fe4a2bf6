//! `Jacobian`: the geometric Jacobian of an arm.

use crate::frame::Frame;
use crate::joints::JOINTS_MAX;
use crate::primitive::{
    CatalogueEntry, Device, Example, Kernel, Parameter, Port, PortType, Real, Slot, Spec, Step,
    UnitRule, operands,
};
use crate::types::NULL_REAL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Jacobian",
        summary: "The geometric Jacobian at joint positions: the twist of the flange per joint velocity.",
        undefined: "overflow: an infinite joint position",
        formula: "column i: [a_i × (p - o_i), a_i] with the axis a_i through o_i and the flange at p (Siciliano et al., Robotics, 2009, section 3.1)",
        examples: &[
            Example::new(
                "stretched up",
                "{device: lwr}",
                "joints | out\n\
             [0, 0, 0, 0, 0, 0, 0] | [[0, -0.868, 0, 0.468, 0, -0.078, 0], [0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0], [0, -1, 0, 1, 0, -1, 0], [1, 0, 1, 0, 1, 0, 1]]\n\
             null | null",
            ),
            Example::new(
                "of the LWR 4+ (pinocchio 4.1.0)",
                "{device: lwr}",
                "joints | out\n\
             [-1.385834571490251, -1.508934551650702, -0.13127889865271847, -0.3481329987433579, -1.586961919235636, -0.5549652320396312, -0.7928431630588717] | [[0.8069893479932386, -0.03884997771179834, -0.15735542351825157, -0.021640254455194623, -0.0026100489004432827, 0.0733787681365057, 0.0], [0.13035384673315467, 0.2076425672446361, -0.030716886264129935, -0.18947361208866093, -0.01712642218656411, -0.025605317381518236, -0.0], [-0.0, 0.8171979985346947, -0.02024332208677085, -0.414530817039353, -0.03726960573406628, 0.006627526579399967, 0.0], [0.0, -0.9829432848905169, 0.1835571548512803, 0.975973662149158, 0.21259518852311166, 0.06350596345884899, -0.3330915221970643], [0.0, -0.18390894129606702, -0.9810630819967274, 0.1743718183246307, -0.8934454704393068, 0.41670864533459495, -0.8476972015797166], [1.0, 0.0, 0.06182232643621351, -0.1306517499512465, 0.39567471130754434, 0.9068191095850209, 0.4128674027752252]]",
            ),
        ],
        inputs: &[Port::new(
            "joints",
            PortType::Joints,
            UnitRule::Joint(0),
            "joint positions, A1 first",
        )],
        outputs: &[Port::new(
            "out",
            PortType::JointColumns(6),
            UnitRule::Typed,
            "one column per joint; rows vx vy vz (m/s) and wx wy wz (rad/s) of the flange, per rad/s of each joint; axes of the base, reference point the origin of the flange",
        )],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Jacobian>()],
);

operands! {
    struct Jacobian { joints: Slot<Real>, out: Slot<Real>, device: Device, width: u32 }
}

impl Step for Jacobian {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let there = frame.arm_at(self.device, self.joints, self.width);
        let jacobian = there.map(|(arm, joints)| arm.jacobian(&joints));
        let finite =
            jacobian.filter(|rows| rows.iter().flatten().all(|element| element.is_finite()));
        let mut row_at = self.out;
        for row in finite.unwrap_or([[NULL_REAL; JOINTS_MAX]; 6]) {
            frame.put_joints(row_at, self.width, Some(&row))?;
            row_at = row_at + self.width;
        }
        Some(())
    }
}
