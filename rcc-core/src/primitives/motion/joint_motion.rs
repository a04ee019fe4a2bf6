//! `JointMotion`: moves all joints together on a straight line in joint space (PTP), to joint positions or to a flange
//! pose.
//!
//! One path parameter moves all joints, so that a stop, a pause or a different speed keeps them on the line.

use super::path_motion::{self, motion_operands};
use crate::frame::{Preparation, PrepareFault};
use crate::joints::JOINTS_MAX;
use crate::path::{Leg, PathRequest, PathSegment, SpeedProfile};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Int, Kernel, NullRule, Parameter, ParameterKind, PortType,
    Prepare, Real, Role, Slot, Spec, UnitRule,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointMotion",
        summary: "Point-to-point motion: all joints together, jerk-limited, to joint positions or to a flange pose.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "q(s) = q₀ + (q₁ − q₀)·s/l; s jerk-limited such that every joint keeps its velocity, acceleration and jerk",
        inputs: &path_motion::INPUTS,
        outputs: &path_motion::OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new(
                "to",
                ParameterKind::Value(PortType::Joints, UnitRule::Joint(0)),
                "joint positions at the end, A1 first; alternative to `pose`",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "pose",
                ParameterKind::Value(PortType::Is(Type::Pose), UnitRule::Typed),
                "flange at the end, in the arm's base; alternative to `to`",
            )
            .default(DefaultValue::Null),
            Parameter::int(
                "branch",
                "with `pose`: branch at the end, 0 to 7 (bit 0 shoulder, 1 elbow, 2 wrist); if omitted, the one reached soonest",
            )
            .default(DefaultValue::Null)
            .at_least(0.0)
            .at_most(7.0),
            Parameter::int(
                "status",
                "with `pose`: KUKA's Status of a 6-axis arm; bits 0 to 2 give the branch",
            )
            .default(DefaultValue::Null)
            .at_least(0.0)
            .at_most(31.0),
            Parameter::int(
                "turn",
                "with `pose`: KUKA's Turn, bit i set if joint i + 1 is negative at the end",
            )
            .default(DefaultValue::Null)
            .at_least(0.0)
            .at_most(255.0),
            path_motion::SCALE,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointMotion>()],
)
.prepared_by::<JointMotion>();

/// Converts a small bit field; `None` if the number is not one.
fn bits(value: i64) -> Option<u8> {
    u8::try_from(value).ok()
}

motion_operands! {
    JointMotion {
        to: Slot<Real>, pose: Slot<Pose>, branch: Slot<Int>, status: Slot<Int>, turn: Slot<Int>,
        scale: Slot<Real>,
    }
}

impl Prepare for JointMotion {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let mut joints = [f64::NAN; JOINTS_MAX];
        for (place, joint) in joints.iter_mut().zip(0..self.width) {
            *place = preparation.get(self.to + joint);
        }
        let segment = if joints.iter().any(|joint| !joint.is_nan()) {
            PathSegment::Joints { to: joints }
        } else {
            PathSegment::JointsToPose {
                to: preparation.get(self.pose),
                branch: bits(preparation.get(self.branch)),
                status: bits(preparation.get(self.status)),
                turn: bits(preparation.get(self.turn)),
            }
        };
        let leg = Leg {
            scale: preparation.get(self.scale),
            ..Leg::new(segment)
        };
        let request = PathRequest {
            device: self.device.0,
            from: None,
            legs: &[leg],
            pace: SpeedProfile::Uniform,
        };
        preparation.motions.path(self.motion.0, &request)
    }
}
