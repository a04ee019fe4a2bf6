//! `LinearMotion`: a jerk-limited straight line of the flange with the shortest rotation and a stop on the path.
//!
//! Without `from` it starts at the arm's hold set-point at the time the command becomes ready; START verifies that the
//! arm is still there. Joints are computed as well, with the arm angle and the branch of the hold set-point.

use super::path_motion::{self, motion_operands};
use crate::frame::{Preparation, PrepareFault};
use crate::path::PathSegment;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Kernel, NullRule, Parameter, ParameterKind, PortType, Prepare,
    Role, Slot, Spec, UnitRule,
};
use crate::types::Type;

const POSE: ParameterKind = ParameterKind::Value(PortType::Is(Type::Pose), UnitRule::Typed);

/// A line may have almost no length but a large rotation: then its linear speed does not limit the rotation.
const TURN: [Parameter; 3] = [
    Parameter {
        doc: "largest angular speed; governs instead of `velocity` on a line with a large rotation over a short distance",
        ..path_motion::FLANGE[3].default(DefaultValue::Real(1.0))
    },
    Parameter {
        doc: "largest angular acceleration",
        ..path_motion::FLANGE[4].default(DefaultValue::Real(4.0))
    },
    Parameter {
        doc: "largest angular jerk",
        ..path_motion::FLANGE[5].default(DefaultValue::Real(40.0))
    },
];

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "LinearMotion",
        summary: "A straight, jerk-limited line to a flange pose, with a soft stop on the path.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "line of the flange and rotation about one axis (slerp) by the same path parameter; joints by inverse kinematics with branch and arm angle of the start, or an arm angle that changes along the path",
        inputs: &path_motion::INPUTS,
        outputs: &path_motion::OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new("to", POSE, "flange at the end, in the arm's base"),
            Parameter::new(
                "from",
                POSE,
                "flange at the start, with joints near the hold set-point; START is refused if the arm is elsewhere; if omitted, the arm's hold set-point",
            )
            .default(DefaultValue::Null),
            path_motion::FLANGE[0],
            path_motion::FLANGE[1],
            path_motion::FLANGE[2],
            TURN[0],
            TURN[1],
            TURN[2],
            path_motion::SCALE,
            path_motion::TIME_OPTIMAL,
            path_motion::STOPS,
            path_motion::ARM_ANGLE,
            path_motion::ELBOW,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::each::<LinearMotion>()],
)
.prepared_by::<LinearMotion>();

motion_operands! {
    LinearMotion { to: Slot<Pose>, from: Slot<Pose> } and flange limits
}

impl Prepare for LinearMotion {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let from = preparation.get(self.from);
        let to = preparation.get(self.to);
        let from = Some(from).filter(Pose::is_finite);
        self.build(preparation, from, PathSegment::Line { to })
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    /// Lines themselves are tested where motions are built (rcc-motion).
    #[test]
    fn null_stops_it_like_true() {
        for stop in [None, Some(true)] {
            let mut bench = PrimitiveHarness::new("LinearMotion");
            bench.set_bool("stop", Some(false)).prepare().unwrap();
            assert_eq!(bench.step().bool("done"), Some(false));
            assert_eq!(bench.set_bool("stop", stop).step().bool("done"), Some(true));
        }
    }
}
