//! Poses of FRI 2.x (quaternions, mm) and 1.x (matrices, mm), and joint positions for a pose and a redundancy value.
//! Pure; run by the clock thread.

use super::fault::CabinetFault;
use super::{JOINTS, Joints};
use crate::fri_iiwa::wire::schema::Transformation;
use crate::sim::arm::impedance::deflection;
use crate::sim::arm::model::{ArmModel, Geometry, Matrix, geometry};

/// Tolerance of a quaternion's length. The value is ours.
const UNIT: f64 = 1e-3;
/// A pose is reached within this distance along and about each axis, m and rad, after at most this number of steps.
const REACHED: f64 = 1e-9;
const NEWTON_STEPS: usize = 16;
/// Joint whose position is KUKA's redundancy value E1: A3.
pub const REDUNDANT_JOINT: usize = 2;

/// Returns the pose as a quaternion transformation: x y z in mm, w x y z.
#[must_use]
pub fn to_wire(here: &Geometry) -> Transformation {
    let [x, y, z] = here.position.map(|value| value * 1e3);
    let [w, i, j, k] = quaternion(&here.rotation);
    Transformation {
        name: Some(String::new()),
        element: vec![x, y, z, w, i, j, k],
        timestamp: None,
    }
}

/// Reads a quaternion transformation; the Jacobian is 0.
///
/// # Errors
/// Returns a fault for another number of elements, values that are not finite, and a quaternion that is not of length 1.
pub fn from_wire(pose: &Transformation) -> Result<Geometry, CabinetFault> {
    let field = "cartesianPose";
    let Ok([x, y, z, w, i, j, k]) = <[f64; 7]>::try_from(pose.element.as_slice()) else {
        return Err(CabinetFault::Missing { field });
    };
    if let Some(element) = pose.element.iter().position(|value| !value.is_finite()) {
        return Err(CabinetFault::NotFinite { field, element });
    }
    let length = (w * w + i * i + j * j + k * k).sqrt();
    if (length - 1.0).abs() > UNIT {
        return Err(CabinetFault::Rotation(length));
    }
    let [w, i, j, k] = [w, i, j, k].map(|part| part / length);
    Ok(Geometry {
        rotation: [
            [
                1.0 - 2.0 * (j * j + k * k),
                2.0 * (i * j - k * w),
                2.0 * (i * k + j * w),
            ],
            [
                2.0 * (i * j + k * w),
                1.0 - 2.0 * (i * i + k * k),
                2.0 * (j * k - i * w),
            ],
            [
                2.0 * (i * k - j * w),
                2.0 * (j * k + i * w),
                1.0 - 2.0 * (i * i + j * j),
            ],
        ],
        position: [x, y, z].map(|value| value * 1e-3),
        jacobian: [[0.0; JOINTS]; 6],
    })
}

/// Returns w x y z, from the largest of the four (Shepperd, 1978).
fn quaternion(r: &Matrix) -> [f64; 4] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let squares = [
        1.0 + trace,
        1.0 + 2.0 * r[0][0] - trace,
        1.0 + 2.0 * r[1][1] - trace,
        1.0 + 2.0 * r[2][2] - trace,
    ];
    let largest = (0..4).max_by(|a, b| squares[*a].total_cmp(&squares[*b]));
    let (wx, wy, wz) = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]);
    let (xy, xz, yz) = (r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]);
    let largest = largest.unwrap_or(0);
    let four_q = 2.0 * squares[largest].max(0.0).sqrt();
    let of = |parts: [f64; 4]| parts.map(|part| part / four_q);
    match largest {
        0 => of([squares[0], wx, wy, wz]),
        1 => of([wx, squares[1], xy, xz]),
        2 => of([wy, xy, squares[2], yz]),
        _ => of([wz, xz, yz, squares[3]]),
    }
}

/// Returns the joint positions near `from` that have this pose, with A3 at `redundancy` (rad): Newton's method.
///
/// # Errors
/// Returns what is left to the pose if the steps do not converge.
pub fn joints_of(
    model: &ArmModel,
    from: &Joints,
    pose: &Geometry,
    redundancy: f64,
) -> Result<Joints, [f64; 6]> {
    let mut joints = *from;
    let mut off = [0.0; 6];
    for _ in 0..NEWTON_STEPS {
        let here = geometry(model, &joints);
        off = deflection(&here, pose);
        let turn = redundancy - joints[REDUNDANT_JOINT];
        if off.iter().all(|off| off.abs() <= REACHED) && turn.abs() <= REACHED {
            return Ok(joints);
        }
        let rows: [[f64; 8]; 7] = std::array::from_fn(|row| match row {
            6 => std::array::from_fn(|column| match column {
                REDUNDANT_JOINT => 1.0,
                7 => turn,
                _ => 0.0,
            }),
            _ => std::array::from_fn(|column| match column {
                7 => off[row],
                _ => here.jacobian[row][column],
            }),
        });
        let Some(step) = solved(rows) else {
            return Err(off);
        };
        for (joint, step) in joints.iter_mut().zip(step) {
            *joint += step;
        }
    }
    Err(off)
}

/// Gaussian elimination with pivoting; `None` for a singular matrix.
fn solved(mut rows: [[f64; 8]; 7]) -> Option<Joints> {
    for pivot in 0..7 {
        let size = |row: &usize| rows[*row][pivot].abs();
        let largest = (pivot..7).max_by(|a, b| size(a).total_cmp(&size(b)))?;
        rows.swap(pivot, largest);
        if rows[pivot][pivot].abs() < 1e-9 {
            return None;
        }
        let (above, below) = rows.split_at_mut(pivot + 1);
        let top = above[pivot];
        for row in below {
            let factor = row[pivot] / top[pivot];
            for (value, from) in row.iter_mut().zip(top).skip(pivot) {
                *value -= factor * from;
            }
        }
    }
    let mut x = [0.0; 7];
    for row in (0..7).rev() {
        let known: f64 = (row + 1..7)
            .map(|column| rows[row][column] * x[column])
            .sum();
        x[row] = (rows[row][7] - known) / rows[row][row];
    }
    x.iter().all(|value| value.is_finite()).then_some(x)
}

/// Returns the distance (m) and the angle (rad) between two poses.
#[must_use]
pub fn distances(one: &Geometry, other: &Geometry) -> (f64, f64) {
    lengths(deflection(one, other))
}

/// Returns the lengths of a translation and a rotation vector.
#[must_use]
pub fn lengths([x, y, z, rx, ry, rz]: [f64; 6]) -> (f64, f64) {
    let length = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    (length([x, y, z]), length([rx, ry, rz]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::iiwa::robot::ArmKind;

    #[test]
    fn a_pose_survives_the_wire_and_leads_back_to_its_joints() {
        let model = ArmKind::Iiwa7.model();
        for q in [
            [0.1, 0.5, -0.3, 1.2, 0.4, -0.7, 0.9],
            [0.0, 0.5, 0.0, -1.5, 0.0, 1.1, 0.0],
            [2.5, -1.0, 1.3, 1.8, -2.2, 1.9, 3.0],
        ] {
            let here = geometry(model, &q);
            let read = from_wire(&to_wire(&here)).expect("a pose");
            let (distance, angle) = distances(&here, &read);
            assert!(distance < 1e-12 && angle < 1e-9, "{distance} {angle}");
            let near = q.map(|q| q + 0.01);
            let found = joints_of(model, &near, &read, q[2]).expect("reachable");
            for (found, q) in found.into_iter().zip(q) {
                assert!((found - q).abs() < 1e-7, "{found} {q}");
            }
        }
    }

    #[test]
    fn what_is_no_pose_is_refused() {
        let of = |element: &[f64]| {
            from_wire(&Transformation {
                element: element.to_vec(),
                ..Transformation::default()
            })
        };
        assert!(matches!(of(&[0.0; 12]), Err(CabinetFault::Missing { .. })));
        let long = [0.0, 0.0, 0.0, 1.1, 0.0, 0.0, 0.0];
        assert!(matches!(of(&long), Err(CabinetFault::Rotation(_))));
        let none = [0.0, f64::NAN, 0.0, 1.0, 0.0, 0.0, 0.0];
        let refused = of(&none);
        assert!(matches!(
            refused,
            Err(CabinetFault::NotFinite { element: 1, .. })
        ));
    }
}
