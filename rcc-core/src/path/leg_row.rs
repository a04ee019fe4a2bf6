//! Legs as rows of numbers: the representation of a path in a plan, with [`WIDTH`] numbers for each leg or spline
//! point, null where no value is given. Written by the language, read when a net is prepared.
//!
//! | column | content |
//! | --- | --- |
//! | 0 | 0 `ptp` to joints, 1 `ptp` to a pose, 2 `lin`, 3 `circ`, 4 a point of a `spline`, 5 its last point |
//! | 1 to 8 | joints (rad), or `[x y z qx qy qz qw]` (m) |
//! | 9 to 11 | `via` of an arc, m; of a `ptp` to a pose: Status, Turn |
//! | 12 | orientation on an arc: 0 even, 1 constant, 2 path |
//! | 13 | angle of an arc, rad |
//! | 14 | blend distance at the end, m |
//! | 15 to 17 | velocity, acceleration, jerk of the flange (m) |
//! | 18 to 20 | the same for its orientation (rad) |
//! | 21 | scale of the joints' limits |
//! | 22 | branch of a `ptp` to a pose |
//! | 23 | relative: 1 to the tool, 2 in axes of the base |
//! | 24 | arm angle at the end, rad |
//! | 25 | elbow: 1 to the middle of its range |
//! | 26, 27 | indices of the conditions `wait` and `until` |

use super::{ArcOrientation, ElbowMotion, Leg, MotionLimits, PathSegment, RelativeTo};
use crate::pose::Pose;

/// Numbers per leg.
pub const WIDTH: usize = 28;

/// `ptp` to joints.
pub const PTP_JOINTS: f64 = 0.0;
/// `ptp` to a pose.
pub const PTP_POSE: f64 = 1.0;
/// `lin`.
pub const LIN: f64 = 2.0;
/// `circ`.
pub const CIRC: f64 = 3.0;
/// A point of a `spline` that is followed by another one.
pub const THROUGH: f64 = 4.0;
/// The last point of a `spline`.
pub const SPLINE: f64 = 5.0;

/// The column of KUKA's Turn, in a row of [`PTP_POSE`].
pub const TURN: usize = 10;

/// The column of the condition `wait`; that of `until` follows.
pub const WAIT: usize = 26;

/// Orientations on an arc, by their number in a row.
pub const ORIENTATIONS: &[&str] = &["even", "constant", "path"];
/// Elbow motions, by their number in a row.
pub const ELBOWS: &[&str] = &["stays", "middle"];

/// A row.
pub type LegRow = [f64; WIDTH];

/// Returns the pose of a row.
#[must_use]
pub fn pose(row: &LegRow) -> Pose {
    let [_, x, y, z, qx, qy, qz, qw, ..] = *row;
    Pose::from_slots([x, y, z, qx, qy, qz, qw])
}

/// Returns the leg of a row; for the last row of a spline, with all its poses. `None` for a spline point that is not
/// the last one, and for an invalid row.
#[must_use]
pub fn leg<'a>(row: &LegRow, through: &'a [Pose]) -> Option<Leg<'a>> {
    let [
        kind,
        a,
        b,
        c,
        d,
        e,
        f,
        g,
        h,
        vx,
        vy,
        vz,
        orientation,
        angle,
        blend,
        v,
        va,
        vj,
        w,
        wa,
        wj,
        scale,
        branch,
        relative,
        arm_angle,
        elbow,
        wait,
        until,
    ] = *row;
    let to = pose(row);
    let segment = if kind == PTP_JOINTS {
        let to = [a, b, c, d, e, f, g, h];
        PathSegment::Joints { to }
    } else if kind == PTP_POSE {
        let number = |value: f64| (0..=u8::MAX).find(|number| f64::from(*number) == value);
        PathSegment::JointsToPose {
            to,
            branch: number(branch),
            status: number(vx),
            turn: number(vy),
        }
    } else if kind == LIN {
        PathSegment::Line { to }
    } else if kind == CIRC {
        PathSegment::Circle {
            via: [vx, vy, vz],
            to,
            orientation: arc_orientation(orientation),
            angle: (!angle.is_nan()).then_some(angle),
        }
    } else if kind == SPLINE {
        PathSegment::Spline { through }
    } else {
        return None;
    };
    Some(Leg {
        segment,
        relative: match relative {
            1.0 => Some(RelativeTo::Tool),
            2.0 => Some(RelativeTo::Base),
            _ => None,
        },
        elbow: self::elbow(arm_angle, elbow),
        line: MotionLimits::of([v, va, vj]),
        turn: MotionLimits::of([w, wa, wj]),
        scale: if scale.is_nan() { 1.0 } else { scale },
        blend: if blend.is_nan() { 0.0 } else { blend },
        wait: condition(wait),
        until: condition(until),
    })
}

/// Returns the index of a condition, at most one `wait` and one `until` for each leg; null: none.
fn condition(number: f64) -> Option<u32> {
    (0..2 * super::LEGS_MAX as u32).find(|index| f64::from(*index) == number)
}

/// Returns the elbow motion for the arm angle at the end (null: not given) and the number of a keyword.
#[must_use]
pub fn elbow(arm_angle: f64, word: f64) -> ElbowMotion {
    match (arm_angle.is_nan(), word) {
        (false, _) => ElbowMotion::To(arm_angle),
        (true, 1.0) => ElbowMotion::Middle,
        (true, _) => ElbowMotion::Stays,
    }
}

/// Returns the orientation for its number in a row.
#[must_use]
pub fn arc_orientation(number: f64) -> ArcOrientation {
    match number {
        1.0 => ArcOrientation::Constant,
        2.0 => ArcOrientation::Path,
        _ => ArcOrientation::Even,
    }
}
