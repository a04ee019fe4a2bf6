//! Every robot file in `configs/robots`: there and back by all branches, for random and for singular joint positions.
//! Tests of files; no thread. `cargo run --release -p rcc-config --example round_trip` does 100,000 positions a robot.

#[path = "../examples/round_trip/trip.rs"]
mod trip;

/// Fewer than the example does: this is a debug build.
const POSITIONS: usize = 2_000;

#[test]
fn every_robot_comes_back_to_every_pose_by_every_branch() {
    let robots = trip::robots();
    let names: Vec<&str> = robots.iter().map(|(file, _)| file.as_str()).collect();
    assert_eq!(
        names,
        [
            "iiwa14.yaml",
            "iiwa7.yaml",
            "kr10_r1420.yaml",
            "kr150_r3100_2.yaml",
            "kr6_r700_sixx.yaml",
            "kr6_r900_2.yaml",
            "lwr4plus.yaml"
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
        // The flange looks forwards.
        assert!(
            (pose.rotate([0.0, 0.0, 1.0])[0] - 1.0).abs() < 1e-12,
            "{file}"
        );
        assert_eq!(robot.arm.status(&upright), Some(0b010), "{file}");
    }
}
