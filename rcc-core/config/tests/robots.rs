//! Round trips for every robot file in `configs/robots`: all branches, random and singular joint positions. Tests of
//! files; no threads. `cargo run --release -p rcc-config --example round_trip` runs 100,000 positions per robot.

#[path = "../examples/round_trip/trip.rs"]
mod trip;

use std::f64::consts::{PI, TAU};

use rcc_config::RobotConfig;
use rcc_core::frame::joints_from;
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_testing::{Random, Rng};
use rs_opw_kinematics::kinematic_traits::{self as opw, Kinematics};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;

/// Fewer than in the example, since this is a debug build.
const POSITIONS: usize = 2_000;

#[test]
fn every_robot_returns_to_every_pose_in_every_branch() {
    let robots = trip::robots();
    let names: Vec<&str> = robots.iter().map(|(file, _)| file.as_str()).collect();
    assert_eq!(
        names,
        [
            "iiwa14.yaml",
            "iiwa7.yaml",
            "iiwa7_springs.yaml",
            "iiwa7_turned.yaml",
            "kr10_r1420.yaml",
            "kr150_r3100_2.yaml",
            "kr6_r700_sixx.yaml",
            "kr6_r900_2.yaml",
            "lwr4plus.yaml",
            "med14.yaml",
            "med7.yaml",
            "med7_turned.yaml",
            "panda.yaml",
            "ur10e.yaml",
            "ur5e.yaml"
        ]
    );
    for (file, robot) in robots {
        let worst = trip::round_trip(&robot, POSITIONS);
        assert!(worst.poses > POSITIONS, "{file}: {worst:?}");
        assert!(
            worst.same < 1e-12 && worst.branches < 1e-12,
            "{file}: {worst:?}"
        );
    }
}

#[test]
fn the_upright_kr_is_as_high_as_its_lengths() {
    // A2 = -90°, A3 = 90°: upper arm up, forearm forwards.
    let upright = [0.0, -90.0, 90.0, 0.0, 0.0, 0.0, 0.0, 0.0].map(f64::to_radians);
    for (file, x, z) in [
        (
            "kr6_r700_sixx.yaml",
            0.025 + 0.365 + 0.08,
            0.4 + 0.315 + 0.035,
        ),
        ("kr6_r900_2.yaml", 0.025 + 0.42 + 0.09, 0.4 + 0.455 + 0.025),
        ("kr10_r1420.yaml", 0.15 + 0.66 + 0.08, 0.45 + 0.61 + 0.02),
        (
            "kr150_r3100_2.yaml",
            0.33 + 1.42 + 0.215,
            0.645 + 1.35 + 0.115,
        ),
    ] {
        let robots = trip::robots();
        let (_, robot) = robots.iter().find(|(name, _)| name == file).expect(file);
        let pose = robot.arm.forward(&upright);
        let [px, py, pz] = pose.position;
        assert!(
            (px - x).abs() < 1e-12 && py.abs() < 1e-12 && (pz - z).abs() < 1e-12,
            "{file}"
        );
        // The flange points forwards.
        assert!(
            (pose.rotate([0.0, 0.0, 1.0])[0] - 1.0).abs() < 1e-12,
            "{file}"
        );
        assert_eq!(robot.arm.status(&upright), Some(0b010), "{file}");
    }
}

/// rs-opw-kinematics has its own closed form and its own parameters for these arms.
#[test]
fn six_axis_arms_agree_with_an_independent_program_in_pose_and_in_every_solution() {
    let theirs = [
        ("kr10_r1420.yaml", Parameters::kuka_kr10_r1420()),
        ("kr150_r3100_2.yaml", Parameters::kuka_kr150_r3100_2()),
        ("kr6_r700_sixx.yaml", Parameters::kuka_kr6_r700_sixx()),
        ("kr6_r900_2.yaml", Parameters::kuka_kr6_r900_2()),
    ];
    let robots = trip::robots();
    for (file, parameters) in theirs {
        let (_, robot) = robots.iter().find(|(name, _)| name == file).unwrap();
        let other = OPWKinematics::new(parameters);
        let compared = (0..POSITIONS as u64).filter(|seed| agrees(robot, &other, *seed));
        let compared = compared.count();
        assert!(
            compared > POSITIONS * 9 / 10,
            "{file}: only {compared} positions are not singular"
        );
    }
}

/// Returns whether one random position was compared. Positions with a nearly singular solution are skipped: there,
/// programs distribute a rotation differently between joints.
fn agrees(robot: &RobotConfig, other: &OPWKinematics, seed: u64) -> bool {
    let arm = robot.arm;
    let joints = random_joints(seed);
    let [q1, q2, q3, q4, q5, q6, ..] = joints;
    let (pose, expected) = (
        arm.forward(&joints),
        other.forward(&[q1, q2, q3, q4, q5, q6]),
    );
    let turned = expected.rotation.to_array();
    let expected_pose = Pose {
        position: expected.translation.to_array(),
        orientation: turned,
    };
    let apart = (
        pose.distance_to(&expected_pose),
        pose.angle_to(&expected_pose),
    );
    assert!(apart.0 < 1e-12 && apart.1 < 1e-12, "{joints:?}: {apart:?}");

    let ours: Vec<Joints> = arm
        .all_branches(&pose, 0.0, &joints)
        .into_iter()
        .flatten()
        .collect();
    if ours
        .iter()
        .any(|found| arm.singularity(found).distance < 1e-3)
    {
        return false;
    }
    let theirs: Vec<opw::Joints> = other.inverse(&expected);
    let same = |a: &Joints, b: &opw::Joints| {
        let turns = a
            .iter()
            .zip(b)
            .map(|(a, b)| (a - b + PI).rem_euclid(TAU) - PI);
        turns.into_iter().all(|turn| turn.abs() < 1e-9)
    };
    for found in &ours {
        assert!(
            theirs.iter().any(|other| same(found, other)),
            "{joints:?}: {found:?} is not in {theirs:?}"
        );
    }
    assert_eq!(ours.len(), theirs.len(), "{joints:?}: {ours:?} {theirs:?}");
    true
}

/// Random joint positions within half a turn.
fn random_joints(seed: u64) -> Joints {
    let mut random = Rng::with_seed(seed);
    let mut joints = [0.0; 8];
    joints[..6].fill_with(|| random.uniform(-PI, PI));
    joints
}

#[test]
fn the_flange_of_a_serial_arm_is_where_pinocchio_puts_it() {
    let robots = trip::robots();
    for name in ["ur5e", "ur10e", "panda"] {
        let file = format!("{name}.yaml");
        let (_, robot) = robots.iter().find(|(it, _)| *it == file).expect(name);
        let path = format!(
            "{}/../../tests/data/kinematics/{name}.csv",
            env!("CARGO_MANIFEST_DIR")
        );
        let text = std::fs::read_to_string(path).unwrap();
        let mut compared = 0;
        for line in text.lines().skip(1) {
            let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
            let (joints, pose) = row.split_at(robot.arm.joints());
            let pose = Pose::from_slots(pose.try_into().unwrap());
            let ours = robot.arm.forward(&joints_from(joints).unwrap());
            let apart = ours.distance_to(&pose).max(ours.angle_to(&pose));
            assert!(apart < 1e-12, "{name}: {apart}");
            compared += 1;
        }
        assert_eq!(compared, 1000);
    }
}

#[test]
fn limits_of_linear_axes_are_in_metres_and_only_in_metres() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../configs/robots/gantry.yaml"
    );
    let text = std::fs::read_to_string(path).expect("it is shipped");
    let robot =
        RobotConfig::parse(&text, "gantry.yaml").unwrap_or_else(|faults| panic!("{faults}"));
    assert!(robot.arm.is_linear());
    let carriage = &robot.joints[0];
    assert_eq!((carriage.lower_rad, carriage.upper_rad), (-0.05, 1.5));
    assert_eq!(carriage.velocity_rad_s, 0.5);
    let setting = serde_json::json!(["250 mm", -0.1]);
    assert_eq!(
        robot.positions(&setting).map(|all| [all[0], all[1]]),
        Some([0.25, -0.1])
    );
    assert_eq!(robot.positions(&serde_json::json!(["20 deg", 0.0])), None);
    for (wrong, words) in [
        ("velocity: 0.5 rad/s", "velocity"),
        ("velocity: 0.5 m/s, dynamics: {}", "dynamics"),
    ] {
        let text = text.replace("velocity: 0.5 m/s", wrong);
        let faults = RobotConfig::parse(&text, "gantry.yaml").expect_err(wrong);
        assert!(faults.to_string().contains(words), "{faults}");
    }
    let text = format!("{text}impedance: {{}}\n");
    let faults = RobotConfig::parse(&text, "gantry.yaml").expect_err("impedance");
    assert!(
        faults.to_string().contains("no meaning for linear axes"),
        "{faults}"
    );
}
