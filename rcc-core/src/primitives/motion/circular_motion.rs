//! `CircularMotion`: a jerk-limited circular arc of the flange through a point, with a stop on the path.
//!
//! The position follows the circle through start, `via` and `to`; the orientation has three modes. Joints are computed
//! as well, with the arm angle and the branch of the start.

use super::path_motion::{self, motion_operands};
use crate::frame::{Preparation, PrepareFault};
use crate::path::{PathSegment, leg_row};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Int, Kernel, NullRule, Parameter, ParameterKind, PortType,
    Prepare, Real, Role, Slot, Spec, UnitRule, Vector3,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "CircularMotion",
        summary: "A jerk-limited circular arc of the flange through a point, with a soft stop on the path.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "circle through start, `via` and `to`; joints by inverse kinematics with branch and arm angle of the start, or an arm angle that changes along the path",
        inputs: &path_motion::INPUTS,
        outputs: &path_motion::OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new(
                "via",
                ParameterKind::Value(PortType::Is(Type::Vector3), UnitRule::Is(Unit::METRE)),
                "a point on the arc, in the arm's base",
            ),
            Parameter::new(
                "to",
                ParameterKind::Value(PortType::Is(Type::Pose), UnitRule::Typed),
                "flange at the end, in the arm's base; with `angle`, another point of the circle",
            ),
            Parameter::new(
                "angle",
                ParameterKind::Value(PortType::Is(Type::Real), UnitRule::RADIAN),
                "angle of the arc, replaces the end at `to`; deg(360) for a full circle; negative: opposite direction",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "orientation",
                ParameterKind::Word(leg_row::ORIENTATIONS),
                "even: rotates evenly from the orientation of the start to that of `to`; constant: stays constant; path: rotates with the circle",
            )
            .default(DefaultValue::Word("even")),
            path_motion::FLANGE[0],
            path_motion::FLANGE[1],
            path_motion::FLANGE[2],
            path_motion::FLANGE[3],
            path_motion::FLANGE[4],
            path_motion::FLANGE[5],
            path_motion::SCALE,
            path_motion::TIME_OPTIMAL,
            path_motion::STOPS,
            path_motion::ARM_ANGLE,
            path_motion::ELBOW,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::each::<CircularMotion>()],
)
.prepared_by::<CircularMotion>();

motion_operands! {
    CircularMotion { via: Slot<Vector3>, to: Slot<Pose>, angle: Slot<Real>, orientation: Slot<Int> } and flange limits
}

impl Prepare for CircularMotion {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let angle = preparation.get(self.angle);
        let segment = PathSegment::Circle {
            via: preparation.get(self.via),
            to: preparation.get(self.to),
            // The language refuses any other number.
            orientation: leg_row::arc_orientation(preparation.get(self.orientation) as f64),
            angle: (!angle.is_nan()).then_some(angle),
        };
        self.build(preparation, None, segment)
    }
}
