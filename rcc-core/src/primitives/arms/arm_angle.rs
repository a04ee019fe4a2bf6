//! `ArmAngle`: the elbow position of a seven-joint arm, and the branch of an arm's joint positions.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Example, Int, Kernel, Parameter, Port, PortType, Real, Slot, Spec,
    Step, UnitRule, operands,
};
use crate::types::{NULL_INT, NULL_REAL};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ArmAngle",
summary: "The arm angle and the branch of joint positions; together with the flange pose they determine the joint positions.",
null: "a null input gives null outputs; an arm of six joints has no arm angle (null), but a branch; an arm with numeric inverse kinematics has an arm angle if it has seven joints, and always branch 0",
undefined: "overflow: an infinite joint position; the arm has no arm angle",
formula: "Shimizu et al., IEEE T-RO 24(5), 2008; branches as Faria et al., Mech. Mach. Theory 121, 2018",
examples: &[Example::new("elbow up; a rotation of joint 1 changes neither", "{device: lwr}", "joints | angle | branch\n\
             [0, -0.5, 0, 1, 0, 0.3, 0] | 0 | 4\n\
             [1.1, -0.5, 0, 1, 0, 0.3, 0] | 0 | 4\n\
             null | null | null"),],
inputs: &[Port::new("joints", PortType::Joints, UnitRule::Joint(0), "joint positions, A1 first")],
outputs: &[Port::real("angle", UnitRule::Is(Unit::RADIAN), "rotation of the elbow about the line from shoulder to wrist, 0 with the elbow up; for an arm of seven joints with numeric inverse kinematics the position of its redundant joint"), Port::int("branch", "0 to 7; seven joints: bit 0 joint 2, bit 1 joint 4, bit 2 joint 6 is negative, in the model's directions; six joints: bit 0 the wrist is behind axis 1, bit 1 the forearm is bent backwards, bit 2 joint 5 is negative").within(0.0, 7.0).diagnostic()],
parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<ArmAngle>()],
);

operands! {
    struct ArmAngle { joints: Slot<Real>, angle: Slot<Real>, branch: Slot<Int>, device: Device, width: u32 }
}

impl Step for ArmAngle {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let found = frame.arm_at(self.device, self.joints, self.width);
        let (radians, number) = found.map_or((NULL_REAL, NULL_INT), |(arm, joints)| {
            (
                arm.arm_angle(&joints).unwrap_or(NULL_REAL),
                i64::from(arm.branch(&joints).index()),
            )
        });
        frame.put(self.angle, radians)?;
        frame.put(self.branch, number)
    }
}
