//! Rotations as unit quaternions `[x y z w]`, and conversions from and to other representations. Pure mathematics
//! without allocation or panic; used by the loader and by the real-time thread.
//!
//! q and −q are the same rotation; no result depends on the sign. A rotation "of B in A" transforms vectors from axes
//! of B to axes of A. Conventions: Solà, "Quaternion kinematics for the error-state Kalman filter", arXiv:1711.02508,
//! table 1 (Hamilton: ij = k, right-handed, local to global).

use core::f64::consts::{FRAC_PI_2, PI};

use crate::vector::{self, PARALLEL_SINE, Vector};

mod matrix;

pub use matrix::{Matrix, from_axes, from_matrix, to_matrix};

/// A unit quaternion `[x y z w]`.
pub type Quaternion = [f64; 4];

/// The identity rotation.
pub const IDENTITY: Quaternion = [0.0, 0.0, 0.0, 1.0];

/// A quaternion whose squared length is this close to 1 is not normalized again: the difference is rounding, not drift.
const UNIT_TOLERANCE: f64 = 1e-14;

/// Two rotations with a half-angle cosine below this count as 180° apart: the shorter way is undetermined.
const HALF_TURN_COSINE: f64 = 1e-9;

/// A pitch this close to ±90° (rad, approximately) counts as gimbal lock: roll and yaw rotate about the same axis.
const GIMBAL_LOCK: f64 = 1e-10;

/// Normalizes a quaternion; `None` if that is impossible (zero, not finite, or too long or short to be squared).
#[must_use]
pub fn unit(quaternion: Quaternion) -> Option<Quaternion> {
    let square = length_squared(quaternion);
    if libm::fabs(square - 1.0) <= UNIT_TOLERANCE {
        return Some(quaternion);
    }
    if square < f64::MIN_POSITIVE || !square.is_finite() {
        return None;
    }
    let length = libm::sqrt(square);
    Some(quaternion.map(|element| element / length))
}

/// Returns the one of q and −q with w > 0 or, for w = 0, with a positive last nonzero element of x, y, z.
#[must_use]
pub fn canonical(quaternion: Quaternion) -> Quaternion {
    let leading = quaternion.iter().rev().find(|element| **element != 0.0);
    match leading {
        Some(element) if *element < 0.0 => quaternion.map(|element| -element),
        _ => quaternion,
    }
}

/// Composes two rotations, `b` first and then `a`, both about axes of the outer frame: C in A from B in A and C in B.
/// The result is normalized.
#[must_use]
pub fn product(a: Quaternion, b: Quaternion) -> Quaternion {
    let [ax, ay, az, aw] = a;
    let [bx, by, bz, bw] = b;
    let product = [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ];
    let length = libm::sqrt(length_squared(product));
    product.map(|element| element / length)
}

/// Returns the inverse rotation.
#[must_use]
pub fn inverse([x, y, z, w]: Quaternion) -> Quaternion {
    [-x, -y, -z, w]
}

/// Transforms a vector from axes of the inner frame to axes of the outer one.
#[must_use]
pub fn rotate([x, y, z, w]: Quaternion, vector: Vector) -> Vector {
    // v + 2w(u × v) + 2u × (u × v), with u = [x y z].
    let axis = [x, y, z];
    let twice = vector::scale(vector::cross(axis, vector), 2.0);
    let turned = vector::add(vector, vector::scale(twice, w));
    vector::add(turned, vector::cross(axis, twice))
}

/// Returns Rz(yaw)·Ry(pitch)·Rx(roll), angles in rad: roll, pitch and yaw about the fixed axes x, y, z.
#[must_use]
pub fn from_rpy([roll, pitch, yaw]: [f64; 3]) -> Quaternion {
    let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|angle| libm::sincos(angle / 2.0));
    [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]
}

/// Returns roll and yaw in [−π, π] and pitch in [−π/2, π/2], rad. At the gimbal lock, pitch ±π/2, only the sum or the
/// difference of roll and yaw is determined, and yaw is 0.
///
/// Uses half sums and differences of the angles, which lose no digits near the gimbal lock: Bernardes & Viollet,
/// "Quaternion to Euler angles conversion: A direct, general and computationally efficient method", PLoS ONE 17(11),
/// 2022.
#[must_use]
pub fn to_rpy([x, y, z, w]: Quaternion) -> [f64; 3] {
    // cos p/2 ± sin p/2 times sine and cosine of (roll ∓ yaw)/2.
    let (plus, minus) = (libm::hypot(x - z, w + y), libm::hypot(x + z, w - y));
    let pitch = 2.0 * libm::atan2(plus, minus) - FRAC_PI_2;
    let mut half_difference = libm::atan2(x - z, w + y);
    let mut half_sum = libm::atan2(x + z, w - y);
    if minus < GIMBAL_LOCK {
        half_sum = half_difference;
    } else if plus < GIMBAL_LOCK {
        half_difference = half_sum;
    }
    let (roll, yaw) = (half_sum + half_difference, half_sum - half_difference);
    [
        within_half_turn(roll),
        bounded(pitch, FRAC_PI_2),
        within_half_turn(yaw),
    ]
}

/// Returns the rotation by |vector| rad about the direction of `vector`: the exponential map.
///
/// sin(θ/2)/θ is computed as a series near 0: Grassia, "Practical parameterization of rotations using the exponential
/// map", Journal of Graphics Tools 3(3), 1998, section 3.
#[must_use]
pub fn exp(vector: Vector) -> Quaternion {
    let angle = vector::norm(vector);
    let factor = if angle < 1e-4 {
        0.5 - angle * angle / 48.0
    } else {
        libm::sin(angle / 2.0) / angle
    };
    let [x, y, z] = vector::scale(vector, factor);
    [x, y, z, libm::cos(angle / 2.0)]
}

/// Returns axis × angle, rad, with a length in [0, π]: the logarithm, inverse of [`exp`]. At 180° both axes are valid,
/// and the one that [`canonical`] prefers is returned.
#[must_use]
pub fn log(quaternion: Quaternion) -> Vector {
    let [x, y, z, w] = canonical(quaternion);
    let sine = vector::norm([x, y, z]);
    // 2·atan2(s, w)/s → 2/w: the first omitted term is of order s².
    let factor = if sine < 1e-9 {
        2.0 / w
    } else {
        2.0 * libm::atan2(sine, w) / sine
    };
    vector::scale([x, y, z], factor)
}

/// Returns the rotation by `angle` (rad) about the direction of `axis`; `None` for an axis of length zero or not
/// finite.
#[must_use]
pub fn from_axis_angle(axis: Vector, angle: f64) -> Option<Quaternion> {
    let (sine, cosine) = libm::sincos(angle / 2.0);
    let [x, y, z] = vector::scale(vector::normalized(axis)?, sine);
    Some([x, y, z, cosine])
}

/// Returns the unit axis, and the angle in [0, π], rad. The identity has the axis z.
#[must_use]
pub fn to_axis_angle(quaternion: Quaternion) -> (Vector, f64) {
    let [x, y, z, w] = canonical(quaternion);
    let axis = vector::normalized([x, y, z]).unwrap_or([0.0, 0.0, 1.0]);
    (axis, 2.0 * libm::atan2(vector::norm([x, y, z]), w))
}

/// Returns the shortest rotation from the direction of `from` to that of `to`; `None` if one has no direction, or if
/// they are opposite, where the axis is undetermined.
#[must_use]
pub fn between(from: Vector, to: Vector) -> Option<Quaternion> {
    let (from, to) = (vector::normalized(from)?, vector::normalized(to)?);
    let sum = vector::add(from, to);
    let square = vector::dot(sum, sum);
    if square < PARALLEL_SINE * PARALLEL_SINE {
        return None;
    }
    let [x, y, z] = vector::cross(from, to);
    // |a + b|² / 2 = 1 + a·b, without the cancellation near the opposite direction.
    unit([x, y, z, square / 2.0])
}

/// Returns the rotation vector that rotates `from` into `to`, in axes of the outer frame, rad, with a length in [0, π]:
/// from + error = to.
#[must_use]
pub fn error(from: Quaternion, to: Quaternion) -> Vector {
    log(product(to, inverse(from)))
}

/// Interpolates between `from` (fraction 0) and `to` (fraction 1; other values extrapolate), by the shorter way about
/// one axis; `None` if they are 180° apart. Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985, eq.
/// for Slerp.
#[must_use]
pub fn slerp(from: Quaternion, to: Quaternion, fraction: f64) -> Option<Quaternion> {
    let turn = canonical(product(to, inverse(from)));
    let [.., cosine] = turn;
    if cosine < HALF_TURN_COSINE {
        return None;
    }
    Some(product(exp(vector::scale(log(turn), fraction)), from))
}

/// Returns the point at `s` (0 = first, 1 = last) of the cubic Bézier curve of four rotations: de Casteljau's
/// construction with [`slerp`] (Shoemake 1985). `None` if two of its rotations are 180° apart.
#[must_use]
pub fn bezier([a, b, c, d]: [Quaternion; 4], s: f64) -> Option<Quaternion> {
    let (ab, bc, cd) = (slerp(a, b, s)?, slerp(b, c, s)?, slerp(c, d, s)?);
    slerp(slerp(ab, bc, s)?, slerp(bc, cd, s)?, s)
}

fn length_squared([x, y, z, w]: Quaternion) -> f64 {
    x * x + y * y + z * z + w * w
}

/// Reduces an angle in (−2π, 2π] by a full turn to [−π, π].
fn within_half_turn(angle: f64) -> f64 {
    let turns = if angle > PI {
        -2.0 * PI
    } else if angle < -PI {
        2.0 * PI
    } else {
        0.0
    };
    bounded(angle + turns, PI)
}

/// Removes an excess beyond ±`bound` caused by rounding; NaN stays.
fn bounded(value: f64, bound: f64) -> f64 {
    if value > bound {
        bound
    } else if value < -bound {
        -bound
    } else {
        value
    }
}

#[cfg(test)]
mod tests;
