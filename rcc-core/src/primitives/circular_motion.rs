//! `CircularMotion`: a jerk-limited circular arc of the flange through a point, with a stop on the path.
//!
//! The position follows the circle through start, `via` and `to`; the orientation has three modes. Joints are computed
//! as well, with the arm angle and the branch of the start.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::{Leg, MotionLimits, PathRequest, PathSegment, leg_row};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Kernel, NullRule, Parameter, ParameterKind, PortType, Role, Spec,
    UnitRule, each,
};
use crate::types::Type;
use crate::unit::Unit;

use super::path_motion::{self, PORTS};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "CircularMotion",
        summary: "A jerk-limited circular arc of the flange through a point, with a soft stop on the path.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "circle through start, `via` and `to`; joints by closed-form inverse kinematics with branch and arm angle of the start, or an arm angle that changes along the path",
        inputs: path_motion::INPUTS,
        outputs: path_motion::OUTPUTS,
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
            path_motion::ARM_ANGLE,
            path_motion::ELBOW,
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
)
.prepared_by(prepare);

fn prepare(preparation: &mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault> {
    let &[
        ..,
        device,
        via,
        to,
        angle,
        orientation,
        v,
        a,
        j,
        w,
        wa,
        wj,
        scale,
        fastest,
        arm_angle,
        elbow,
        motion,
        _width,
    ] = operands
    else {
        return Ok(());
    };
    let number = |slot: u32| {
        let [value] = preparation.reals(slot);
        value
    };
    let angle = number(angle);
    let orientation = preparation.int(orientation);
    let segment = PathSegment::Circle {
        via: preparation.reals(via),
        to: Pose::from_slots(preparation.reals(to)),
        // The language refuses any other number.
        orientation: leg_row::arc_orientation(orientation as f64),
        angle: (!angle.is_nan()).then_some(angle),
    };
    let leg = Leg {
        line: MotionLimits::of([v, a, j].map(number)),
        turn: MotionLimits::of([w, wa, wj].map(number)),
        elbow: path_motion::elbow(preparation, [arm_angle, elbow]),
        scale: number(scale),
        ..Leg::new(segment)
    };
    let request = PathRequest {
        device,
        from: None,
        legs: &[leg],
        pace: path_motion::pace(preparation, fastest),
    };
    preparation.motions.path(motion, &request)
}

fn step(frame: &mut Frame<'_>, operands: [u32; PORTS + 17]) {
    let (ports, rest) = (operands.first_chunk::<PORTS>(), operands.last_chunk::<2>());
    if let (Some(ports), Some([motion, width])) = (ports, rest) {
        path_motion::step(frame, *ports, *motion, *width);
    }
}
