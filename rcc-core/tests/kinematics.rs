//! The LWR 4+ against golden data of independent programs (pinocchio 4.1.0, which Orocos KDL agrees with).
//! Runs off any real-time thread; the data is in `tests/data/kinematics` of the workspace.

use std::f64::consts::PI;

use rcc_core::kinematics::SrsArm;
use rcc_core::pose::Pose;
use serde_json::Value;

const LWR: SrsArm = SrsArm {
    shoulder_height: 0.3105,
    upper_arm: 0.4,
    forearm: 0.39,
    wrist_to_flange: 0.078,
    signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
};

fn data(name: &str) -> String {
    let path = format!(
        "{}/../tests/data/kinematics/{name}",
        env!("CARGO_MANIFEST_DIR")
    );
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn cases() -> Vec<Value> {
    let file: Value = serde_json::from_str(&data("lwr4plus.json")).unwrap();
    let cases = file["cases"].as_array().unwrap().clone();
    assert_eq!(cases.len(), 1041);
    cases
}

fn numbers<const N: usize>(case: &Value, key: &str) -> [f64; N] {
    let list: Vec<f64> = case[key]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    list.try_into().unwrap()
}

fn worst<'a>(a: impl IntoIterator<Item = &'a f64>, b: impl IntoIterator<Item = &'a f64>) -> f64 {
    a.into_iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

fn elements(pose: &Pose) -> ([f64; 3], Vec<f64>) {
    (
        pose.position,
        pose.rotation_matrix().into_iter().flatten().collect(),
    )
}

#[test]
fn forward_agrees_with_the_golden_data() {
    for case in cases() {
        let (position, rotation) = elements(&LWR.forward(&numbers(&case, "q")));
        assert!(
            worst(&position, &numbers::<3>(&case, "p")) < 1e-12,
            "{case}"
        );
        assert!(
            worst(&rotation, &numbers::<9>(&case, "R")) < 1e-12,
            "{case}"
        );
    }
}

#[test]
fn the_quaternion_agrees_with_the_golden_data() {
    for case in cases() {
        let golden = Pose {
            position: [0.0; 3],
            orientation: numbers(&case, "quat_xyzw"),
        };
        assert!(
            LWR.forward(&numbers(&case, "q")).angle_to(&golden) < 1e-12,
            "{case}"
        );
    }
}

#[test]
fn the_jacobian_agrees_with_the_golden_data() {
    for case in cases() {
        let jacobian = LWR.jacobian(&numbers(&case, "q"));
        assert!(
            worst(jacobian.iter().flatten(), &numbers::<42>(&case, "J")) < 1e-12,
            "{case}"
        );
    }
}

#[test]
fn inverse_leads_back_to_every_golden_pose() {
    for case in cases() {
        let q = numbers(&case, "q");
        let pose = LWR.forward(&q);
        let found = LWR
            .inverse(&pose, LWR.arm_angle(&q), LWR.branch(&q), &q)
            .unwrap();
        let ((position, rotation), (golden_position, golden_rotation)) =
            (elements(&LWR.forward(&found)), elements(&pose));
        assert!(worst(&position, &golden_position) < 1e-12, "{case}");
        assert!(worst(&rotation, &golden_rotation) < 1e-12, "{case}");
    }
}

#[test]
fn the_arm_angle_is_the_one_of_the_predecessor() {
    let text = data("lwr4plus_arm_angle.csv");
    let mut compared = 0;
    for line in text.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let [q @ .., alpha] = <[f64; 8]>::try_from(row).unwrap();
        // With a straight elbow the predecessor answers with q3.
        if q[3].abs() < 1e-5 {
            continue;
        }
        let difference = (LWR.arm_angle(&q) - alpha).rem_euclid(2.0 * PI);
        // The predecessor takes an arc cosine, which costs it half of the digits near 0 and π.
        assert!(
            difference.min(2.0 * PI - difference) < 1e-6,
            "{q:?}: {difference}"
        );
        compared += 1;
    }
    assert_eq!(compared, 1026);
}
