//! Geometry of the LWR 4+, computed from its Denavit-Hartenberg table independently of the RCC's own kinematics.
//! Pure functions; run by the simulator's clock thread.

use super::{JOINTS, Joints};

/// Link offsets along the joint axes, m (data sheet: 310.5, 400, 390 and 78 mm).
const D: Joints = [0.3105, 0.0, 0.400, 0.0, 0.390, 0.0, 0.078];
/// Sine of the twist angle to the next axis, which is +90°, −90° or 0.
const TWIST_SINE: Joints = [1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 0.0];

/// A 3×3 matrix, by rows.
pub type Matrix = [[f64; 3]; 3];

/// Pose and Jacobian of the flange at one joint position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Rotation from flange to base coordinates.
    pub rotation: Matrix,
    /// Flange in the base frame, m.
    pub position: [f64; 3],
    /// Geometric Jacobian at the flange, base axes; rows vx vy vz wx wy wz.
    pub jacobian: [Joints; 6],
}

/// Forward kinematics and Jacobian: `A_i = Rz(q_i) Tz(d_i) Rx(α_i)`, column `[z × (p − o); z]`.
pub fn geometry(q: &Joints) -> Geometry {
    let links = link_frames(q);
    let LinkFrame {
        rotation, position, ..
    } = links[JOINTS - 1];
    let mut jacobian = [[0.0; JOINTS]; 6];
    for (joint, link) in links.iter().enumerate() {
        let linear = cross(&link.axis, &difference(&position, &link.origin));
        for row in 0..3 {
            jacobian[row][joint] = linear[row];
            jacobian[row + 3][joint] = link.axis[row];
        }
    }
    Geometry {
        rotation,
        position,
        jacobian,
    }
}

/// A link at one joint position, base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkFrame {
    /// Direction of its joint's axis.
    pub axis: [f64; 3],
    /// A point of that axis, m.
    pub origin: [f64; 3],
    /// Rotation from link to base coordinates.
    pub rotation: Matrix,
    /// Origin of the link's frame, m.
    pub position: [f64; 3],
}

/// Returns the link behind each joint.
pub fn link_frames(q: &Joints) -> [LinkFrame; JOINTS] {
    let mut rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut position = [0.0; 3];
    std::array::from_fn(|joint| {
        let (axis, origin) = (column(&rotation, 2), position);
        for (p, z) in position.iter_mut().zip(axis) {
            *p += D[joint] * z;
        }
        rotation = multiply(&rotation, &joint_rotation(q[joint], TWIST_SINE[joint]));
        LinkFrame {
            axis,
            origin,
            rotation,
            position,
        }
    })
}

/// Decodes a pose in FRI's format; the Jacobian is 0.
pub fn geometry_of(pose: &[f32; 12]) -> Geometry {
    let value = |row: usize, column: usize| f64::from(pose[4 * row + column]);
    Geometry {
        rotation: std::array::from_fn(|row| std::array::from_fn(|column| value(row, column))),
        position: std::array::from_fn(|row| value(row, 3)),
        jacobian: [[0.0; JOINTS]; 6],
    }
}

impl Geometry {
    /// Returns the pose in FRI's format, 3×4 row-major `[R|p]`.
    pub fn pose(&self) -> [f32; 12] {
        pose(&self.rotation, &self.position)
    }

    /// Returns the difference to `base` in FRI's format: rotation `R Rbᵀ` and translation `p − pb`.
    pub fn offset_from(&self, base: &Geometry) -> [f32; 12] {
        pose(
            &multiply(&self.rotation, &transposed(&base.rotation)),
            &difference(&self.position, &base.position),
        )
    }

    /// Returns the Jacobian in KUKA's order: 6×7 row-major, rows X Y Z Rz Ry Rx.
    pub fn wire_jacobian(&self) -> [f32; 6 * JOINTS] {
        let order = [0, 1, 2, 5, 4, 3];
        std::array::from_fn(|i| self.jacobian[order[i / JOINTS]][i % JOINTS] as f32)
    }

    /// Returns the velocity of the flange, m/s, base axes.
    pub fn flange_velocity(&self, joint_velocity: &Joints) -> [f64; 3] {
        std::array::from_fn(|row| {
            self.jacobian[row]
                .iter()
                .zip(joint_velocity)
                .map(|(j, v)| j * v)
                .sum()
        })
    }

    /// Returns the joint torques caused by a wrench (force N, torque Nm, base axes) on the flange, Nm: `Jᵀ F`.
    pub fn joint_torque(&self, wrench: &[f64; 6]) -> Joints {
        std::array::from_fn(|joint| {
            (0..6)
                .map(|row| self.jacobian[row][joint] * wrench[row])
                .sum()
        })
    }
}

fn joint_rotation(q: f64, twist_sine: f64) -> Matrix {
    let (s, c) = q.sin_cos();
    let twist_cosine = 1.0 - twist_sine.abs();
    [
        [c, -s * twist_cosine, s * twist_sine],
        [s, c * twist_cosine, -c * twist_sine],
        [0.0, twist_sine, twist_cosine],
    ]
}

fn pose(rotation: &Matrix, position: &[f64; 3]) -> [f32; 12] {
    std::array::from_fn(|i| match i % 4 {
        3 => position[i / 4] as f32,
        column => rotation[i / 4][column] as f32,
    })
}

fn column(m: &Matrix, index: usize) -> [f64; 3] {
    [m[0][index], m[1][index], m[2][index]]
}

fn transposed(m: &Matrix) -> Matrix {
    [column(m, 0), column(m, 1), column(m, 2)]
}

fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn difference(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_golden_configurations() {
        let text = include_str!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/data/kinematics/lwr4plus.json"
        ));
        let golden: serde_json::Value = serde_json::from_str(text).unwrap();
        let numbers = |case: &serde_json::Value, key: &str| -> Vec<f64> {
            case[key]
                .as_array()
                .unwrap()
                .iter()
                .map(|v| v.as_f64().unwrap())
                .collect()
        };
        let cases = golden["cases"].as_array().unwrap();
        assert!(cases.len() > 1000);
        for case in cases {
            let ours = geometry(&numbers(case, "q").try_into().unwrap());
            let close = |ours: &[f64], key: &str| {
                let golden = numbers(case, key);
                assert_eq!(ours.len(), golden.len());
                assert!(
                    ours.iter().zip(golden).all(|(a, b)| (a - b).abs() < 1e-12),
                    "{key} of {case}"
                );
            };
            close(&ours.position, "p");
            close(ours.rotation.as_flattened(), "R");
            close(ours.jacobian.as_flattened(), "J");
        }
    }

    #[test]
    fn kuka_sends_the_rotational_rows_from_z_to_x() {
        let geometry = geometry(&[0.1, 0.5, -0.3, 1.2, 0.4, -0.7, 0.9]);
        let wire = geometry.wire_jacobian();
        for joint in 0..JOINTS {
            assert_eq!(wire[2 * JOINTS + joint], geometry.jacobian[2][joint] as f32);
            assert_eq!(wire[3 * JOINTS + joint], geometry.jacobian[5][joint] as f32);
            assert_eq!(wire[5 * JOINTS + joint], geometry.jacobian[3][joint] as f32);
        }
    }
}
