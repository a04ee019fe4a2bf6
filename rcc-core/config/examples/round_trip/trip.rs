//! Round trip from joints to pose to joints to pose. Shared by a test and an example; any thread.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use rcc_config::{CellConfig, RobotConfig};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::pose::Pose;
use rcc_testing::{Random, Rng};

/// Largest errors found.
#[derive(Debug, Default)]
pub struct Worst {
    /// Largest difference between poses by the branch of the joints, m or element of the rotation matrix.
    pub same: f64,
    /// The same over all branches.
    pub branches: f64,
    /// Number of poses compared.
    pub poses: usize,
}

/// Returns the robot files by name; robots with fewer than six joints reach no pose.
pub fn robots() -> Vec<(String, RobotConfig)> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let files = std::fs::read_dir(configs.join("robots")).expect("the folder of robots");
    let names = files.map(|file| file.expect("a file").file_name());
    let mut names: Vec<String> = names
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    names.sort();
    let read = |name: String| {
        let text =
            format!("cell: a\nperiod: 1 ms\ndevices:\n  b: {{driver: c, robot: robots/{name}}}\n");
        let cell = CellConfig::parse(&text, "test.yaml", &configs, &BTreeMap::new());
        let mut cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
        (name, cell.devices.remove(0).robot.expect("a robot"))
    };
    let robots = names.into_iter().map(read);
    robots.filter(|(_, robot)| robot.joints.len() > 5).collect()
}

/// Checks random joint positions within the limits, and each combination of limits, zeros and right angles of joints 2
/// to 6.
pub fn round_trip(robot: &RobotConfig, positions: usize) -> Worst {
    let mut worst = Worst::default();
    let limits = robot.limits();
    let mut random = Rng::with_seed(1);
    for _ in 0..positions {
        let mut joints: Joints = [0.0; JOINTS_MAX];
        for index in 0..robot.joints.len() {
            joints[index] = random.uniform(limits.lower[index], limits.upper[index]);
        }
        compare(robot, &joints, &mut worst);
    }
    let special = [0.0, FRAC_PI_2, -FRAC_PI_2, 1e-7, -1e-10];
    for number in 0..special.len().pow(5) {
        let mut joints: Joints = [0.3, 0.0, 0.0, 0.0, 0.0, 0.0, -0.4, 0.0];
        let mut rest = number;
        for joint in joints.iter_mut().skip(1).take(5) {
            *joint = special[rest % special.len()];
            rest /= special.len();
        }
        for joint in joints.iter_mut().skip(robot.joints.len()) {
            *joint = 0.0;
        }
        compare(robot, &joints, &mut worst);
    }
    worst
}

fn compare(robot: &RobotConfig, joints: &Joints, worst: &mut Worst) {
    let arm = &robot.arm;
    let (pose, start) = (arm.forward(joints), arm.configuration(joints));
    let same = arm.inverse(&pose, start.arm_angle, start.branch, joints);
    match same {
        Ok(found) => worst.same = worst.same.max(apart(&arm.forward(&found), &pose)),
        // A pose of a valid configuration must have a solution.
        Err(_) => worst.same = f64::INFINITY,
    }
    worst.poses += 1;
    for found in arm
        .all_branches(&pose, start.arm_angle, joints)
        .into_iter()
        .flatten()
    {
        worst.branches = worst.branches.max(apart(&arm.forward(&found), &pose));
        worst.poses += 1;
    }
}

fn apart(a: &Pose, b: &Pose) -> f64 {
    let moved = a.position.into_iter().zip(b.position);
    let turned = a.rotation_matrix().into_iter().flatten();
    let turned = turned.zip(b.rotation_matrix().into_iter().flatten());
    moved
        .chain(turned)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}
