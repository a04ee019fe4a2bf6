//! `SplineMotion`: a jerk-limited smooth curve of the flange through poses, with a stop on the path.
//!
//! A natural spline of degree 5 in position and orientation: among all curves through the poses, it has the least mean
//! square of the third derivative. Joints are computed as well, with the arm angle and the branch of the start.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::{LEGS_MAX, Leg, MotionLimits, PathRequest, PathSegment};
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Dim, Kernel, NullRule, Parameter, ParameterKind, Role, Spec, each,
};

use super::path_motion::{self, PORTS};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SplineMotion",
        summary: "A jerk-limited smooth curve of the flange through poses, with a soft stop on the path.",
        null: path_motion::NULL,
        null_rule: NullRule::Known,
        formula: "natural spline of degree 5 (de Boor, A Practical Guide to Splines, XIII) over chord length, followed by arc length; orientation in modified Rodrigues parameters",
        inputs: path_motion::INPUTS,
        outputs: path_motion::OUTPUTS,
        parameters: &[
            Parameter::arm(),
            Parameter::new(
                "through",
                ParameterKind::Poses(Dim::Var(0)),
                "poses of the flange in the arm's base through which the curve passes, up to 128; the last one is the end",
            ),
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
        through,
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
        count,
    ] = operands
    else {
        return Ok(());
    };
    let number = |slot: u32| {
        let [value] = preparation.reals(slot);
        value
    };
    let mut poses = [Pose::NULL; LEGS_MAX];
    let places = (0..count).map(|row| through + 7 * row);
    for (pose, place) in poses.iter_mut().zip(places) {
        *pose = Pose::from_slots(preparation.reals(place));
    }
    let through = poses.get(..count as usize);
    let Some(through) = through else {
        return Err(super::motion_sequence::too_many(motion, count));
    };
    let leg = Leg {
        line: MotionLimits::of([v, a, j].map(number)),
        turn: MotionLimits::of([w, wa, wj].map(number)),
        elbow: path_motion::elbow(preparation, [arm_angle, elbow]),
        scale: number(scale),
        ..Leg::new(PathSegment::Spline { through })
    };
    let request = PathRequest {
        device,
        from: None,
        legs: &[leg],
        pace: path_motion::pace(preparation, fastest),
    };
    preparation.motions.path(motion, &request)
}

fn step(frame: &mut Frame<'_>, operands: [u32; PORTS + 15]) {
    let (ports, rest) = (operands.first_chunk::<PORTS>(), operands.last_chunk::<3>());
    if let (Some(ports), Some([motion, width, _])) = (ports, rest) {
        path_motion::step(frame, *ports, *motion, *width);
    }
}
