//! Rotation matrices, row-major, and the rotation nearest to an approximate rotation matrix. Pure mathematics without
//! allocation or panic; used by the loader and by the real-time thread.

use super::{Quaternion, canonical, unit};
use crate::vector::{self, PARALLEL_SINE, Vector};

/// Three rows; the columns are the axes of the inner frame in axes of the outer one.
pub type Matrix = [[f64; 3]; 3];

/// Largest deviation of an element of MᵀM from the identity; a matrix beyond it is not accepted as a rotation.
const ORTHONORMAL_TOLERANCE: f64 = 1e-3;

/// Returns the rotation matrix of a unit quaternion.
#[must_use]
pub fn to_matrix([x, y, z, w]: Quaternion) -> Matrix {
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * w),
            2.0 * (x * z + y * w),
        ],
        [
            2.0 * (x * y + z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * w),
        ],
        [
            2.0 * (x * z - y * w),
            2.0 * (y * z + x * w),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

/// Returns the rotation nearest to a matrix; `None` if an element of MᵀM − 1 exceeds 10⁻³, or for a reflection.
///
/// Three steps of M ← M(3 − MᵀM)/2 make it orthonormal to rounding (Björck & Bowie, "An iterative algorithm for
/// computing the best estimate of an orthogonal matrix", SIAM J. Numer. Anal. 8(2), 1971); then Shepperd, "Quaternion
/// from rotation matrix", J. Guidance and Control 1(3), 1978, which divides by the largest element. w ≥ 0.
#[must_use]
pub fn from_matrix(matrix: &Matrix) -> Option<Quaternion> {
    let [a, b, c] = *matrix;
    let mirrors = vector::dot(vector::cross(a, b), c) < 0.0;
    let fits = deviation(matrix) <= ORTHONORMAL_TOLERANCE;
    if mirrors || !fits {
        return None;
    }
    let near = nearer(&nearer(&nearer(matrix)));
    unit(canonical(shepperd(&near)))
}

/// Returns the rotation whose x axis points along `x` and whose y axis is in the half plane of `y`; `None` if one has
/// no direction or they are parallel.
#[must_use]
pub fn from_axes(x: Vector, y: Vector) -> Option<Quaternion> {
    let (x, y) = (vector::normalized(x)?, vector::normalized(y)?);
    let z = vector::cross(x, y);
    if vector::norm(z) < PARALLEL_SINE {
        return None;
    }
    let z = vector::normalized(z)?;
    // Computed again, so that z is perpendicular to x even where the cross product lost digits.
    let y = vector::normalized(vector::cross(z, x))?;
    let [z1, z2, z3] = vector::cross(x, y);
    let ([x1, x2, x3], [y1, y2, y3]) = (x, y);
    unit(canonical(shepperd(&[
        [x1, y1, z1],
        [x2, y2, z2],
        [x3, y3, z3],
    ])))
}

/// Returns MᵀM, by rows.
fn gram([[a, b, c], [d, e, f], [g, h, i]]: &Matrix) -> Matrix {
    let (x, y, z) = ([*a, *d, *g], [*b, *e, *h], [*c, *f, *i]);
    let row = |u: Vector| [vector::dot(u, x), vector::dot(u, y), vector::dot(u, z)];
    [row(x), row(y), row(z)]
}

/// Returns the largest element of |MᵀM − 1|; NaN for a matrix with NaN.
fn deviation(matrix: &Matrix) -> f64 {
    let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = gram(matrix);
    let off = [xx - 1.0, yy - 1.0, zz - 1.0, xy, xz, yz].map(libm::fabs);
    off.into_iter().fold(0.0, |worst, next| {
        if next > worst || next.is_nan() {
            next
        } else {
            worst
        }
    })
}

fn nearer(matrix: &Matrix) -> Matrix {
    let [g0, g1, g2] = gram(matrix);
    // G is symmetric: its columns equal its rows.
    matrix.map(|row| {
        let product = [
            vector::dot(row, g0),
            vector::dot(row, g1),
            vector::dot(row, g2),
        ];
        vector::scale(vector::subtract(vector::scale(row, 3.0), product), 0.5)
    })
}

fn shepperd([[a, b, c], [d, e, f], [g, h, i]]: &Matrix) -> Quaternion {
    let trace = a + e + i;
    if trace > libm::fmax(libm::fmax(*a, *e), *i) {
        [h - f, c - g, d - b, 1.0 + trace]
    } else if a >= e && a >= i {
        [1.0 + a - e - i, b + d, c + g, h - f]
    } else if e >= i {
        [b + d, 1.0 - a + e - i, f + h, c - g]
    } else {
        [c + g, f + h, 1.0 - a - e + i, d - b]
    }
}
