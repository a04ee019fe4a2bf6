//! The files in `configs/` are valid, and the simulated arm of the demo can move from its start. Tests of files; no
//! threads, no sockets except the search for a free port.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_config::{CellConfig, OnRelease, Protocol, auto_ports, free_port};
use rcc_core::frame::joints_from;
use rcc_core::impedance::ImpedanceLimits;
use rcc_core::kinematics::{Arm, SrsArm};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_core::primitive::ChannelKind;

/// Maximum speed of nets in the demo, m/s.
const SPEED_M_S: f64 = 0.25;
/// Required distance to each joint limit.
const MARGIN_RAD: f64 = 0.17;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../configs")
        .join(name)
}

fn load(name: &str) -> CellConfig {
    CellConfig::load_offline(&file(name)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Start position of the demo's simulated arm, rad.
fn start() -> Joints {
    let cell = load("cells/demo.yaml");
    let simulator = &cell.simulators[0];
    assert_eq!(simulator.program, "lwr-sim");
    let argument = simulator
        .arguments
        .iter()
        .find_map(|a| a.strip_prefix("--start="));
    let numbers = argument.unwrap().split(',').map(|n| n.parse().unwrap());
    let numbers: Vec<f64> = numbers.collect();
    assert_eq!(numbers.len(), 7);
    joints_from(&numbers).unwrap()
}

#[test]
fn the_cells_are_read_without_a_fault() {
    for (name, cell, devices) in [
        ("cells/demo.yaml", "demo", &["lwr", "io"][..]),
        ("cells/lwr.yaml", "lwr", &["lwr"]),
        ("cells/iiwa.yaml", "iiwa", &["iiwa"]),
        ("cells/iiwa-demo.yaml", "iiwa-demo", &["lwr", "io"]),
        ("cells/iiwa-impedance.yaml", "iiwa-impedance", &["iiwa"]),
        (
            "cells/lwr-and-iiwa.yaml",
            "lwr-and-iiwa",
            &["left", "right"],
        ),
        ("cells/ethercat.yaml", "ethercat", &["line"]),
        ("cells/ethercat-drives.yaml", "ethercat-drives", &["table"]),
        ("cells/impedance.yaml", "impedance", &["lwr"]),
    ] {
        let config = load(name);
        assert_eq!(config.name, cell);
        assert_eq!(config.period_ns, 1_000_000);
        let names: Vec<_> = config.devices.iter().map(|device| &device.name).collect();
        assert_eq!(names, devices);
    }
}

#[test]
fn the_demo_takes_the_ports_that_were_chosen_for_it() {
    let path = file("cells/demo.yaml");
    let automatic = auto_ports(&path).unwrap();
    let names: Vec<_> = automatic
        .iter()
        .map(|(name, protocol)| (name.as_str(), *protocol))
        .collect();
    assert_eq!(names, [("fri", Protocol::Udp), ("io", Protocol::Tcp)]);
    let chosen: BTreeMap<_, _> = automatic
        .into_iter()
        .map(|(name, protocol)| (name, free_port(protocol).unwrap()))
        .collect();
    let cell = CellConfig::load(&path, &chosen).unwrap();
    assert_eq!(cell.ports, chosen);
    let fri = format!("127.0.0.1:{}", chosen["fri"]);
    assert_eq!(cell.devices[0].settings["listen"], fri);
    assert!(
        cell.simulators[0]
            .arguments
            .contains(&format!("--driver={fri}"))
    );
}

#[test]
fn the_real_cell_listens_at_kukas_port_and_simulates_nothing() {
    let cell = CellConfig::load(&file("cells/lwr.yaml"), &BTreeMap::new()).unwrap();
    assert_eq!(cell.ports["fri"], 49938);
    assert!(cell.simulators.is_empty());
}

#[test]
fn every_torch_goes_out_on_release() {
    for name in ["cells/demo.yaml", "cells/lwr.yaml"] {
        let cell = load(name);
        let torch = cell.devices[0]
            .channel(ChannelKind::DigitalOutput, "torch")
            .unwrap();
        assert_eq!(torch.on_release, Some(OnRelease::Safe(0.0)));
    }
}

#[test]
fn the_lwr_matches_the_golden_data() {
    let robot = load("cells/lwr.yaml").devices.remove(0).robot.unwrap();
    let expected = Arm::Srs(SrsArm {
        shoulder_height: 0.3105,
        upper_arm: 0.4,
        forearm: 0.39,
        wrist_to_flange: 0.078,
        signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
    });
    assert_eq!(robot.arm, expected);
    let column = |of: fn(&rcc_config::JointConfig) -> f64| {
        let degrees = robot
            .joints
            .iter()
            .map(|joint| of(joint).to_degrees().round());
        degrees.collect::<Vec<_>>()
    };
    let position = [170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0];
    assert_eq!(column(|joint| joint.upper_rad), position);
    assert_eq!(column(|joint| -joint.lower_rad), position);
    let velocity = [110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0];
    assert_eq!(column(|joint| joint.velocity_rad_s), velocity);
    let acceleration = [1200.0, 1200.0, 1600.0, 1600.0, 2500.0, 4400.0, 4400.0];
    assert_eq!(column(|joint| joint.acceleration_rad_s2), acceleration);
    assert!(robot.joints.iter().all(|joint| joint.jerk_rad_s3 > 0.0));
}

#[test]
fn the_impedance_limits_of_the_lwr_are_those_of_fri() {
    let limits = load("cells/lwr.yaml").models()[0].impedance.unwrap();
    let expected = ImpedanceLimits {
        translation: [0.0, 5000.0],
        rotation: [0.0, 300.0],
        joint: [0.0, 2000.0],
        damping: [0.0, 1.0],
        rate: 2.0,
        force: 50.0,
        torque: 10.0,
        joint_torque: 15.0,
    };
    assert_eq!(limits, expected);
}

#[test]
fn the_demo_starts_with_the_tool_down_in_front_of_the_arm() {
    let robot = load("cells/demo.yaml").devices.remove(0).robot.unwrap();
    let pose = robot.arm.forward(&start());
    let expected = [0.537_749_907_475_931, 0.0, 0.383_910_161_513_775];
    for (have, want) in pose.position.iter().zip(expected) {
        assert!((have - want).abs() < 1e-9, "{pose:?}");
    }
    let rotation = pose.rotation_matrix();
    assert!(
        rotation[2][2] < -1.0 + 1e-12,
        "the flange's z axis points down: {rotation:?}"
    );
}

#[test]
fn lines_around_the_start_stay_within_the_joint_limits() {
    let robot = load("cells/demo.yaml").devices.remove(0).robot.unwrap();
    let (arm, limits, start) = (robot.arm, robot.limits(), start());
    let (pose, angle, branch) = (
        arm.forward(&start),
        arm.arm_angle(&start).unwrap(),
        arm.branch(&start),
    );
    let steps = 200;
    for (axis, length) in [
        (0, 0.2),
        (0, -0.1),
        (1, 0.2),
        (1, -0.2),
        (2, 0.2),
        (2, -0.2),
    ] {
        let mut last = start;
        for step in 1..=steps {
            let mut position = pose.position;
            position[axis] += length * f64::from(step) / f64::from(steps);
            let target = Pose { position, ..pose };
            let joints = arm.inverse(&target, angle, branch, &last).unwrap();
            let step_s = f64::abs(length) / f64::from(steps) / SPEED_M_S;
            for joint in 0..7 {
                let at = format!(
                    "joint {} on axis {axis} by {length} m, step {step}",
                    joint + 1
                );
                assert!(joints[joint] > limits.lower[joint] + MARGIN_RAD, "{at}");
                assert!(joints[joint] < limits.upper[joint] - MARGIN_RAD, "{at}");
                let velocity = (joints[joint] - last[joint]).abs() / step_s;
                assert!(
                    velocity < limits.velocity_max[joint],
                    "{at}: {velocity} rad/s"
                );
            }
            last = joints;
        }
    }
}
