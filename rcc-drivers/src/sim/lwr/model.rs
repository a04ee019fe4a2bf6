//! The arm of the LWR 4+, and its geometry in the formats of FRI 1.0.
//! Pure functions; run by the simulator's clock thread.

use super::{JOINTS, Joints};
use crate::sim::arm::model::{self, ArmModel, Geometry, Matrix, difference, multiply, transposed};

/// Lengths: data sheet (310.5, 400, 390 and 78 mm). Masses and centres: the URDF of the LWR by Centro E. Piaggio
/// (kuka-lwr); KUKA publishes none. Radius and friction are our own: the URDFs of others contradict each other.
pub const LWR_4_PLUS: ArmModel = ArmModel {
    offset: [0.3105, 0.0, 0.400, 0.0, 0.390, 0.0, 0.078],
    twist_sine: [1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 0.0],
    mass: [2.0, 2.0, 2.0, 2.0, 2.0, 0.2, 0.2],
    centre: [
        [0.0, -0.06, 0.24],
        [0.0, 0.06, 0.3805],
        [0.0, 0.06, 0.6405],
        [0.0, -0.06, 0.7805],
        [0.0, 0.0, 1.0345],
        [0.0, 0.0, 1.163],
        [0.0, 0.0, 1.1785],
    ],
    radius: 0.07,
    friction: [0.4, 0.4, 0.2, 0.2, 0.2, 0.1, 0.1],
    damping: [0.4, 0.4, 0.2, 0.2, 0.2, 0.1, 0.1],
};

/// Returns pose and Jacobian of the flange at `q` (rad).
pub fn geometry(q: &Joints) -> Geometry {
    model::geometry(&LWR_4_PLUS, q)
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
}

fn pose(rotation: &Matrix, position: &[f64; 3]) -> [f32; 12] {
    std::array::from_fn(|i| match i % 4 {
        3 => position[i / 4] as f32,
        column => rotation[i / 4][column] as f32,
    })
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
