//! A virtual wall for tests of impedance, and the stiffness that an arm shows when it is pressed into one.
//! Runs in the test harness.

use super::JOINTS;

/// Distance of the wall's plane from the flange, m.
const DEPTH: f64 = 0.005;
/// Largest deviation of the shown stiffness from the expected one, as a share.
const TOLERANCE: f64 = 0.02;
/// Smallest torque that counts as a load of a joint, N·m.
const LOAD_MIN: f64 = 0.2;

/// Returns the request for a wall 5 mm behind `flange` (m, base frame) with its normal along `axis`.
pub fn wall_behind<T: serde::de::DeserializeOwned>(flange: [f64; 3], axis: usize) -> T {
    let mut point = flange;
    point[axis] += DEPTH;
    let mut normal = [0.0; 3];
    normal[axis] = 1.0;
    let request = serde_json::json!({
        "wall": {"point": point, "normal": normal, "stiffness": 5000, "damping": 100}
    });
    serde_json::from_value(request).expect("a request")
}

/// Asserts that `load` / `displacement` is the expected stiffness within 2 %.
pub fn assert_stiffness(load: f64, displacement: f64, expected: f64) {
    let shown = load / displacement;
    let words = format!("{shown} instead of {expected}: {load} over {displacement}");
    assert!((shown - expected).abs() <= TOLERANCE * expected, "{words}");
}

/// Torques (N·m), positions (rad) and expected stiffness (N·m/rad), by joint.
pub struct JointLoad<'a> {
    /// Torque by the wall.
    pub external: &'a [f64],
    /// Torque that is commanded on top of the springs.
    pub added: &'a [f64],
    /// Measured position.
    pub measured: &'a [f64],
    /// Position at which the springs hold.
    pub held: &'a [f64],
    /// Expected stiffness.
    pub stiffness: &'a [f64],
}

/// Asserts the stiffness of each joint that wall and added torques load; returns the number of joints that the wall loads.
pub fn assert_joint_stiffness(load: &JointLoad<'_>) -> usize {
    let loaded = (0..JOINTS).filter(|&joint| {
        let torque = load.external[joint] + load.added[joint];
        if torque.abs() > LOAD_MIN {
            let displacement = load.measured[joint] - load.held[joint];
            assert_stiffness(torque, displacement, load.stiffness[joint]);
        }
        load.external[joint].abs() > LOAD_MIN
    });
    loaded.count()
}
