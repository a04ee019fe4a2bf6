//! Rotations about single axes, and the distribution of a rotation to two or three of them: shared by all arms. Pure
//! arithmetic; used by the loader and by the real-time thread.

use nalgebra::{Matrix3, Vector3};

use crate::pose::Pose;

/// Maximum number of axes of an arm.
pub const AXES_MAX: usize = 7;

/// Below this sine of the angle between them two axes count as aligned, and the hint decides how they share the
/// rotation …
const ALIGNED_SINE: f64 = 1e-9;

/// … unless the pose would then be wrong by more than this angle (rad).
const HINT_ERROR: f64 = 1e-12;

/// A wrist beyond the stretched (or within the folded) arm by less than this, relative to the arm's length, counts as
/// stretched (or folded): rounding.
pub(super) const STRETCH_TOLERANCE: f64 = 1e-12;

/// Below this distance from a singularity (see [`super::singularity::Singularity::distance`]) rounding may decide how joints share
/// a rotation: a hint that reaches the pose by itself is then the solution …
pub(super) const NEAR_SINGULAR: f64 = 1e-3;

/// … if its arm angle is the required one to this tolerance (rad).
pub(super) const SAME_ARM_ANGLE: f64 = 1e-9;

/// Returns true if two poses are equal to the tolerance within which a hint decides, 10⁻¹² m and rad. False for null.
pub(super) fn is_same_pose(a: &Pose, b: &Pose) -> bool {
    a.distance_to(b) <= HINT_ERROR && a.angle_to(b) <= HINT_ERROR
}

pub(super) fn sign(negative: bool) -> f64 {
    if negative { -1.0 } else { 1.0 }
}

/// Returns `m`·Rz of an angle with this sine and cosine.
pub(super) fn turned_z(m: &Matrix3<f64>, (sin, cos): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(
        m.m11 * cos + m.m12 * sin,
        m.m12 * cos - m.m11 * sin,
        m.m13,
        m.m21 * cos + m.m22 * sin,
        m.m22 * cos - m.m21 * sin,
        m.m23,
        m.m31 * cos + m.m32 * sin,
        m.m32 * cos - m.m31 * sin,
        m.m33,
    )
}

/// Returns `m`·Ry of an angle with this sine and cosine.
pub(super) fn turned_y(m: &Matrix3<f64>, (sin, cos): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(
        m.m11 * cos - m.m13 * sin,
        m.m12,
        m.m11 * sin + m.m13 * cos,
        m.m21 * cos - m.m23 * sin,
        m.m22,
        m.m21 * sin + m.m23 * cos,
        m.m31 * cos - m.m33 * sin,
        m.m32,
        m.m31 * sin + m.m33 * cos,
    )
}

/// Returns Rz of an angle with this sine and cosine.
pub(super) fn rz((sin, cos): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

/// Returns the x axis of a frame; `y_of` and `z_of` return the other axes.
pub(super) fn x_of(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m.m11, m.m21, m.m31)
}

pub(super) fn y_of(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m.m12, m.m22, m.m32)
}

pub(super) fn z_of(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m.m13, m.m23, m.m33)
}

/// Returns the length of a vector in a plane of metres or of sines: its squares cannot overflow, and if they underflow
/// it counts as aligned.
pub(super) fn length(x: f64, y: f64) -> f64 {
    libm::sqrt(x * x + y * y)
}

/// A direction as two angles, with their sines and cosines, so that these need not be computed again.
pub(super) struct PolarDirection {
    pub azimuth: f64,
    pub polar: f64,
    pub turn: (f64, f64),
    pub tilt: (f64, f64),
}

/// Returns azimuth and polar angle of the unit vector (x, y, z) = Rz(azimuth)·Ry(polar)·e_z with the given sign of the
/// polar angle; the azimuth of a vector along z is `hint`.
pub(super) fn azimuth_polar(x: f64, y: f64, z: f64, sign: f64, hint: f64) -> PolarDirection {
    let level = length(x, y);
    if level < ALIGNED_SINE
        && let Some((along, turn)) = beside_hint(x, y, hint, HINT_ERROR)
    {
        return PolarDirection {
            azimuth: hint,
            polar: libm::atan2(along, z),
            turn,
            tilt: (along, z),
        };
    }
    let (sin, cos) = (sign * y, sign * x);
    PolarDirection {
        azimuth: libm::atan2(sin, cos),
        polar: sign * libm::atan2(level, z),
        turn: (sin / level, cos / level),
        tilt: (sign * level, z),
    }
}

/// Returns the extent of (x, y) in the direction of `hint` (rad), which may be negative, and the sine and cosine of
/// `hint`; `None` if (x, y) is more than `tolerance` beside that direction. A null hint makes them null.
#[cold]
pub(super) fn beside_hint(x: f64, y: f64, hint: f64, tolerance: f64) -> Option<(f64, (f64, f64))> {
    let (sin, cos) = libm::sincos(hint);
    let beside = y * cos - x * sin;
    let along = x * cos + y * sin;
    (beside.is_nan() || beside.abs() <= tolerance).then_some((along, (sin, cos)))
}

/// Returns the three angles of Rz·Ry·Rz = `rest` with the given sign of the second; the first is `hint` where the
/// second is 0 or π.
pub(super) fn wrist(rest: &Matrix3<f64>, sign: f64, hint: f64) -> (f64, f64, f64) {
    let axis = azimuth_polar(rest.m13, rest.m23, rest.m33, sign, hint);
    // Computed from the residual instead of W31 and W32, which vanish with the second angle.
    let (sin, cos) = axis.turn;
    let third = libm::atan2(
        cos * rest.m21 - sin * rest.m11,
        cos * rest.m22 - sin * rest.m12,
    );
    (axis.azimuth, axis.polar, third)
}

pub(super) fn matrix(&[[a, b, c], [d, e, f], [g, h, i]]: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::new(a, b, c, d, e, f, g, h, i)
}

pub(super) fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [
        [m.m11, m.m12, m.m13],
        [m.m21, m.m22, m.m23],
        [m.m31, m.m32, m.m33],
    ]
}
