//! Measures our kinematics and those of rs-opw-kinematics at the positions of a file: `kinematics ROBOT[:opw] CHAIN
//! POSITIONS POSES` writes the chain of a robot of `configs/robots` (ours only), poses and Jacobians, and prints one
//! line of JSON. Used by `bench/kinematics/compare`, which runs other programs in turns with it;
//! `bench/kinematics/program.hpp` defines the format.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;
use std::fs;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use rcc_bench::motion::{DAMPING, TWIST};
use rcc_config::CellConfig;
use rcc_core::frame::joints_from;
use rcc_core::kinematics::{Arm, ArmConfiguration};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rs_opw_kinematics::kinematic_traits::{Kinematics, Pose as OpwPose};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;

const BATCHES: usize = 100;

/// Names of the measured functions, and ns per call.
type Figures = Vec<(&'static str, f64)>;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [robot, chain, positions, poses] = arguments.as_slice() else {
        return Err("usage: kinematics ROBOT[:opw] CHAIN POSITIONS POSES".into());
    };
    let (name, opw) = match robot.split_once(':') {
        Some((name, _)) => (name, true),
        None => (robot.as_str(), false),
    };
    let arm = read_arm(name)?;
    let positions = read_positions(positions)?;
    let (version, figures) = if opw {
        let other = OPWKinematics::new(opw_parameters(&arm)?);
        fs::write(poses, opw_poses(&other, &arm, &positions))?;
        ("3.0", opw_figures(&other, &positions))
    } else {
        fs::write(chain, chain_of(&arm)?)?;
        fs::write(poses, our_poses(&arm, &positions))?;
        (env!("CARGO_PKG_VERSION"), our_figures(&arm, &positions))
    };
    let figures = figures
        .iter()
        .map(|(name, ns)| format!(", \"{name}\": {ns}"));
    println!(
        "{{\"version\": \"{version}\"{}}}",
        figures.collect::<String>()
    );
    Ok(())
}

fn read_arm(name: &str) -> Result<Arm, Box<dyn Error>> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let text =
        format!("cell: a\nperiod: 1 ms\ndevices:\n  b: {{driver: c, robot: robots/{name}.yaml}}\n");
    let cell = CellConfig::parse(&text, "kinematics", &configs, &BTreeMap::new());
    let mut cell = cell.map_err(|faults| faults.to_string())?;
    let robot = cell.devices.remove(0).robot.ok_or("it has no robot")?;
    Ok(robot.arm)
}

fn read_positions(path: &str) -> Result<Vec<Joints>, Box<dyn Error>> {
    let read = |line: &str| {
        let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
        joints_from(&numbers?).ok_or_else(|| "too many joints".into())
    };
    fs::read_to_string(path)?.lines().map(read).collect()
}

/// Returns the chain as axes and origins: the flange in the last joint's frame, then axis, origin, zero and sign of
/// each joint.
fn chain_of(arm: &Arm) -> Result<String, Box<dyn Error>> {
    const Y: [f64; 3] = [0.0, 1.0, 0.0];
    const Z: [f64; 3] = [0.0, 0.0, 1.0];
    let up = |z: f64| [0.0, 0.0, z];
    let (tip, joints): (f64, Vec<_>) = match arm {
        Arm::Srs(arm) => {
            let origins = [
                arm.shoulder_height,
                0.0,
                0.0,
                arm.upper_arm,
                0.0,
                arm.forearm,
                0.0,
            ];
            let axes = [Z, Y, Z, Y, Z, Y, Z].into_iter().zip(origins.map(up));
            let joints = axes.zip(arm.signs).map(|(joint, sign)| (joint, 0.0, sign));
            (arm.wrist_to_flange, joints.collect())
        }
        Arm::OrthoParallel(arm) => {
            let origins = [
                up(0.0),
                [arm.shoulder_offset, arm.lateral_offset, arm.shoulder_height],
                up(arm.upper_arm),
                [arm.elbow_offset, 0.0, arm.forearm],
                up(0.0),
                up(0.0),
            ];
            let axes = [Z, Y, Y, Z, Y, Z].into_iter().zip(origins);
            let directions = arm.zeros.into_iter().zip(arm.signs);
            let joints = axes.zip(directions);
            let joints = joints.map(|(joint, (zero, sign))| (joint, zero, sign));
            (arm.wrist_to_flange, joints.collect())
        }
        Arm::Serial(_) => return Err("the format of chains is for arms in closed form".into()),
    };
    let mut text = format!("0 0 {tip:?}\n");
    for (([ax, ay, az], [x, y, z]), zero, sign) in joints {
        let _ = writeln!(text, "{ax} {ay} {az} {x:?} {y:?} {z:?} {zero:?} {sign}"); // A String takes everything.
    }
    Ok(text)
}

/// Returns a line for each position: position, rotation and Jacobian.
fn lines(arm: &Arm, positions: &[Joints], pose: impl Fn(&Joints) -> Pose) -> String {
    let line = |joints: &Joints| {
        let pose = pose(joints);
        let rotation = pose.rotation_matrix().into_iter().flatten();
        let rows = arm.jacobian(joints).into_iter();
        let jacobian = rows.flat_map(|row| row.into_iter().take(arm.joints()));
        let numbers = pose.position.into_iter().chain(rotation).chain(jacobian);
        let words: Vec<String> = numbers.map(|number| format!("{number:?}")).collect();
        words.join(" ") + "\n"
    };
    positions.iter().map(line).collect()
}

fn our_poses(arm: &Arm, positions: &[Joints]) -> String {
    lines(arm, positions, |joints| {
        // Inverse kinematics and forward again, so that the inverse is compared as well.
        let pose = arm.forward(joints);
        let ArmConfiguration { branch, arm_angle } = arm.configuration(joints);
        match arm.inverse(&pose, arm_angle, branch, joints) {
            Ok(found) => arm.forward(&found),
            Err(_) => Pose::NULL,
        }
    })
}

/// Returns the poses of rs-opw-kinematics; it has no closed-form Jacobian, so ours takes its place.
fn opw_poses(other: &OPWKinematics, arm: &Arm, positions: &[Joints]) -> String {
    lines(arm, positions, |joints| {
        let pose = other.forward(&six_joints(joints));
        Pose {
            position: pose.translation.to_array(),
            orientation: pose.rotation.to_array(),
        }
    })
}

/// Returns ns per call: the best of several batches, each of which goes through all positions. Other programs on the
/// machine only add time.
fn measure(positions: usize, mut call: impl FnMut(usize)) -> f64 {
    let batch = |_| {
        let begun = Instant::now();
        (0..positions).for_each(&mut call);
        begun.elapsed().as_nanos() as f64 / positions as f64
    };
    (0..BATCHES).map(batch).fold(f64::INFINITY, f64::min)
}

fn our_figures(arm: &Arm, positions: &[Joints]) -> Figures {
    let places: Vec<(Joints, Pose, ArmConfiguration)> = positions
        .iter()
        .map(|joints| (*joints, arm.forward(joints), arm.configuration(joints)))
        .collect();
    let count = places.len();
    vec![
        (
            "forward",
            measure(count, |k| {
                black_box(arm.forward(black_box(&places[k].0)));
            }),
        ),
        (
            "jacobian",
            measure(count, |k| {
                black_box(arm.jacobian(black_box(&places[k].0)));
            }),
        ),
        (
            "velocity",
            measure(count, |k| {
                black_box(arm.joint_velocities(black_box(&places[k].0), &TWIST, DAMPING));
            }),
        ),
        (
            "inverse",
            measure(count, |k| {
                let (hint, pose, ArmConfiguration { branch, arm_angle }) = black_box(&places[k]);
                black_box(arm.inverse(pose, *arm_angle, *branch, hint)).ok();
            }),
        ),
        (
            "inverse_all",
            measure(count, |k| {
                let (hint, pose, configuration) = black_box(&places[k]);
                black_box(&arm.all_branches(pose, configuration.arm_angle, hint));
            }),
        ),
    ]
}

fn opw_figures(other: &OPWKinematics, positions: &[Joints]) -> Figures {
    let joints: Vec<[f64; 6]> = positions.iter().map(six_joints).collect();
    let poses: Vec<OpwPose> = joints.iter().map(|joints| other.forward(joints)).collect();
    let count = joints.len();
    vec![
        (
            "forward",
            measure(count, |k| {
                black_box(other.forward(black_box(&joints[k])));
            }),
        ),
        (
            "inverse",
            measure(count, |k| {
                black_box(other.inverse_continuing(black_box(&poses[k]), &joints[k]));
            }),
        ),
        (
            "inverse_all",
            measure(count, |k| {
                black_box(other.inverse(black_box(&poses[k])));
            }),
        ),
    ]
}

/// Returns the parameters of rs-opw-kinematics with the lengths of our robot file.
fn opw_parameters(arm: &Arm) -> Result<Parameters, Box<dyn Error>> {
    let Arm::OrthoParallel(arm) = arm else {
        return Err("rs-opw-kinematics knows arms of six axes only".into());
    };
    Ok(Parameters {
        a1: arm.shoulder_offset,
        a2: arm.elbow_offset,
        b: arm.lateral_offset,
        c1: arm.shoulder_height,
        c2: arm.upper_arm,
        c3: arm.forearm,
        c4: arm.wrist_to_flange,
        offsets: arm.zeros.map(|zero| -zero),
        sign_corrections: arm.signs.map(|sign| sign as i8),
        dof: 6,
    })
}

fn six_joints(&[q1, q2, q3, q4, q5, q6, ..]: &Joints) -> [f64; 6] {
    [q1, q2, q3, q4, q5, q6]
}
