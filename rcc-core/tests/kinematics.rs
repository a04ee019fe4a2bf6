//! Arms in closed form against golden data of independent programs (pinocchio 4.1.0, which Orocos KDL agrees with).
//! Runs off any real-time thread; the data is in `tests/data/kinematics` of the workspace.

use std::f64::consts::PI;

use rcc_core::frame::joints_from;
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_testing::arms;
use serde_json::Value;

const LWR: Arm = Arm::Srs(arms::LWR);
const KR6: Arm = Arm::OrthoParallel(arms::KR6);

fn data(name: &str) -> String {
    let path = format!(
        "{}/../tests/data/kinematics/{name}",
        env!("CARGO_MANIFEST_DIR")
    );
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Each golden case with its arm.
fn cases() -> Vec<(Arm, Value)> {
    let of = |arm: Arm, name: &str, count: usize| {
        let file: Value = serde_json::from_str(&data(name)).unwrap();
        let cases = file["cases"].as_array().unwrap().clone();
        assert_eq!(cases.len(), count);
        cases.into_iter().map(move |case| (arm, case))
    };
    let lwr = of(LWR, "lwr4plus.json", 1041);
    lwr.chain(of(KR6, "kr6_r900_2.json", 1015)).collect()
}

fn numbers(case: &Value, key: &str) -> Vec<f64> {
    let list = case[key].as_array().unwrap().iter();
    list.map(|x| x.as_f64().unwrap()).collect()
}

fn joints(case: &Value) -> Joints {
    joints_from(&numbers(case, "q")).unwrap()
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
fn links_have_the_lengths_of_the_arm_and_end_at_the_flange() {
    for (arm, case) in cases() {
        let q = joints(&case);
        let points = arm.link_points(&q);
        let origins = points.as_slice();
        let length = |from: usize| {
            let squares =
                (0..3).map(|axis| (origins[from + 1][axis] - origins[from][axis]).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let wanted = match arm {
            Arm::Srs(it) => [
                it.shoulder_height,
                it.upper_arm,
                it.forearm,
                it.wrist_to_flange,
            ],
            Arm::OrthoParallel(it) => [
                it.shoulder_height
                    .hypot(it.shoulder_offset)
                    .hypot(it.lateral_offset),
                it.upper_arm,
                it.forearm.hypot(it.elbow_offset),
                it.wrist_to_flange,
            ],
            Arm::Serial(_) => panic!("closed form"),
        };
        let found = [0, 1, 2, 3].map(length);
        assert!(worst(&found, &wanted) < 1e-12, "{found:?}, not {wanted:?}");
        assert_eq!(origins[4], arm.forward(&q).position);
    }
}

#[test]
fn forward_agrees_with_the_golden_data() {
    for (arm, case) in cases() {
        let (position, rotation) = elements(&arm.forward(&joints(&case)));
        assert!(worst(&position, &numbers(&case, "p")) < 1e-12, "{case}");
        assert!(worst(&rotation, &numbers(&case, "R")) < 1e-12, "{case}");
    }
}

#[test]
fn the_quaternion_agrees_with_the_golden_data() {
    for (arm, case) in cases() {
        let golden = Pose {
            position: [0.0; 3],
            orientation: numbers(&case, "quat_xyzw").try_into().unwrap(),
        };
        let turned = arm.forward(&joints(&case)).angle_to(&golden);
        assert!(turned < 1e-12, "{case}");
    }
}

#[test]
fn the_jacobian_agrees_with_the_golden_data() {
    for (arm, case) in cases() {
        let (jacobian, golden) = (arm.jacobian(&joints(&case)), numbers(&case, "J"));
        assert_eq!(golden.len(), 6 * arm.joints());
        let ours = jacobian.iter().flat_map(|row| &row[..arm.joints()]);
        assert!(worst(ours, &golden) < 1e-12, "{case}");
        let unused = jacobian.iter().flat_map(|row| &row[arm.joints()..]);
        assert!(unused.into_iter().all(|element| *element == 0.0));
    }
}

#[test]
fn the_twist_agrees_with_the_golden_data() {
    for (arm, case) in cases() {
        let rates = numbers(&case, "qd");
        let jacobian = arm.jacobian(&joints(&case));
        let twist: Vec<f64> = jacobian
            .iter()
            .map(|row| row.iter().zip(&rates).map(|(j, rate)| j * rate).sum())
            .collect();
        let golden = [numbers(&case, "twist_lin"), numbers(&case, "twist_ang")].concat();
        assert!(worst(&twist, &golden) < 1e-12, "{case}");
    }
}

#[test]
fn inverse_leads_back_to_every_golden_pose() {
    for (arm, case) in cases() {
        let q = joints(&case);
        let (pose, start) = (arm.forward(&q), arm.configuration(&q));
        let found = arm
            .inverse(&pose, start.arm_angle, start.branch, &q)
            .unwrap();
        let ((position, rotation), (golden_position, golden_rotation)) =
            (elements(&arm.forward(&found)), elements(&pose));
        assert!(worst(&position, &golden_position) < 1e-12, "{case}");
        assert!(worst(&rotation, &golden_rotation) < 1e-12, "{case}");
    }
}

#[test]
fn every_branch_leads_to_every_golden_pose() {
    let mut found = 0;
    for (arm, case) in cases() {
        let q = joints(&case);
        let (pose, angle) = (arm.forward(&q), arm.arm_angle(&q).unwrap_or(0.0));
        for joints in arm.all_branches(&pose, angle, &q).into_iter().flatten() {
            let there = arm.forward(&joints);
            assert!(there.distance_to(&pose) < 1e-12, "{case}");
            assert!(there.angle_to(&pose) < 2e-12, "{case}");
            found += 1;
        }
    }
    assert!(found > 12_000, "{found}");
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
        let difference =
            (LWR.arm_angle(&joints_from(&q).unwrap()).unwrap() - alpha).rem_euclid(2.0 * PI);
        // The predecessor takes an arc cosine, which costs it half of the digits near 0 and π.
        assert!(
            difference.min(2.0 * PI - difference) < 1e-6,
            "{q:?}: {difference}"
        );
        compared += 1;
    }
    assert_eq!(compared, 1026);
}
