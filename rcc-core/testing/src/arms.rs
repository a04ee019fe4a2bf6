//! The arms of tests and benchmarks. `rcc-core` includes this file in its unit tests, for which the types of the
//! package `rcc-testing` would be those of another build of `rcc-core`.

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, JointAxis, OrthoParallelArm, SerialArm, SrsArm};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::pose::Pose;

/// A KUKA LWR 4+.
pub const LWR: SrsArm = SrsArm {
    shoulder_height: 0.3105,
    upper_arm: 0.4,
    forearm: 0.39,
    wrist_to_flange: 0.078,
    signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
};

/// A KUKA LBR iiwa 14.
pub const IIWA: SrsArm = SrsArm {
    shoulder_height: 0.36,
    upper_arm: 0.42,
    forearm: 0.4,
    wrist_to_flange: 0.126,
    signs: [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0],
};

/// A KUKA KR 6 R900-2.
pub const KR6: OrthoParallelArm = OrthoParallelArm {
    shoulder_height: 0.4,
    shoulder_offset: 0.025,
    lateral_offset: 0.0,
    upper_arm: 0.455,
    elbow_offset: -0.025,
    forearm: 0.42,
    wrist_to_flange: 0.09,
    signs: [-1.0, 1.0, 1.0, -1.0, 1.0, -1.0],
    zeros: [0.0, core::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0, 0.0],
};

/// Returns an arm with the lengths d1, a2, a3, d4, d5 and d6 (m) of Universal Robots' tables.
#[must_use]
fn universal_robot([d1, a2, a3, d4, d5, d6]: [f64; 6]) -> SerialArm {
    let down = [0.0, 0.0, -1.0];
    let right = [0.0, -1.0, 0.0];
    let axes = [
        ([0.0, 0.0, d1], [0.0, 0.0, 1.0]),
        ([0.0, 0.0, d1], right),
        ([a2, 0.0, d1], right),
        ([a2 + a3, 0.0, d1], right),
        ([a2 + a3, -d4, d1], down),
        ([a2 + a3, -d4, d1 - d5], right),
    ];
    let flange = Pose::from_xyz_rpy(
        [a2 + a3, -d4 - d6, d1 - d5],
        [core::f64::consts::FRAC_PI_2, 0.0, 0.0],
    );
    serial(&axes, flange, 0)
}

/// Returns an arm of these points (m) and directions.
fn serial(axes: &[([f64; 3], [f64; 3])], flange: Pose, redundant_joint: usize) -> SerialArm {
    let mut all = [JointAxis {
        point: [0.0; 3],
        direction: [0.0, 0.0, 1.0],
    }; 7];
    for (place, (point, direction)) in all.iter_mut().zip(axes) {
        *place = JointAxis {
            point: *point,
            direction: *direction,
        };
    }
    let arm = SerialArm::new(&all[..axes.len()], flange, redundant_joint);
    arm.expect("axes with directions")
}

/// Returns a Universal Robots UR5e.
#[must_use]
pub fn ur5e() -> SerialArm {
    universal_robot([0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996])
}

/// Returns a Universal Robots UR10e.
#[must_use]
pub fn ur10e() -> SerialArm {
    universal_robot([0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655])
}

/// Returns a Franka Panda, whose redundant joint is the third.
#[must_use]
pub fn panda() -> SerialArm {
    let (up, left, right) = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]);
    let axes = [
        ([0.0, 0.0, 0.333], up),
        ([0.0, 0.0, 0.333], left),
        ([0.0, 0.0, 0.649], up),
        ([0.0825, 0.0, 0.649], right),
        ([0.0, 0.0, 1.033], up),
        ([0.0, 0.0, 1.033], right),
        ([0.088, 0.0, 1.033], [0.0, 0.0, -1.0]),
    ];
    let flange = Pose::from_xyz_rpy([0.088, 0.0, 0.926], [core::f64::consts::PI, 0.0, 0.0]);
    serial(&axes, flange, 2)
}

/// In front of a UR5e, flange down, rad.
pub const UR_HOLD: Joints = [0.2, -1.4, 1.8, -2.0, -1.5, 0.3, 0.0, 0.0];

/// In front of a Panda, flange down, rad.
pub const PANDA_HOLD: Joints = [0.1, -0.6, 0.1, -2.2, 0.1, 1.7, 0.7, 0.0];

/// Returns a UR5e with the limits of its robot file.
#[must_use]
pub fn ur5e_model() -> DeviceModel {
    let full = [-360.0, 360.0];
    model(
        Arm::Serial(ur5e()),
        [full, full, [-180.0, 180.0], full, full, full],
        [180.0; 6],
        [600.0; 6],
    )
}

/// Returns a Panda with the limits of its robot file, but the jerk of [`model`].
#[must_use]
pub fn panda_model() -> DeviceModel {
    let degrees = |values: [f64; 7]| values.map(f64::to_degrees);
    model(
        Arm::Serial(panda()),
        PANDA_JOINTS.map(|range| range.map(f64::to_degrees)),
        degrees([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        degrees([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
    )
}

/// Returns three parallel axes, as those of a SCARA before its vertical one.
#[must_use]
pub fn planar() -> SerialArm {
    let up = [0.0, 0.0, 1.0];
    let axes = [
        ([0.0, 0.0, 0.3], up),
        ([0.35, 0.0, 0.3], up),
        ([0.65, 0.0, 0.3], up),
    ];
    serial(&axes, Pose::from_xyz_rpy([0.65, 0.0, 0.1], [0.0; 3]), 0)
}

/// Joint ranges of a Panda, rad.
pub const PANDA_JOINTS: [[f64; 2]; 7] = [
    [-2.8973, 2.8973],
    [-1.7628, 1.7628],
    [-2.8973, 2.8973],
    [-3.0718, -0.0698],
    [-2.8973, 2.8973],
    [-0.0175, 3.7525],
    [-2.8973, 2.8973],
];

/// Joint ranges of the LWR 4+ and of the iiwa, deg.
pub const SEVEN_JOINTS: [[f64; 2]; 7] = [
    [-170.0, 170.0],
    [-120.0, 120.0],
    [-170.0, 170.0],
    [-120.0, 120.0],
    [-170.0, 170.0],
    [-120.0, 120.0],
    [-170.0, 170.0],
];

/// Joint ranges of the KR 6 R900-2, deg.
pub const SIX_JOINTS: [[f64; 2]; 6] = [
    [-170.0, 170.0],
    [-190.0, 45.0],
    [-120.0, 156.0],
    [-185.0, 185.0],
    [-120.0, 120.0],
    [-350.0, 350.0],
];

/// Elbow up, flange down, in front of an LWR 4+, rad.
pub const HOLD: Joints = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

/// Returns degrees in radians; 0 for missing joints.
#[must_use]
pub fn radians<const N: usize>(degrees: [f64; N]) -> Joints {
    let mut all = [0.0; JOINTS_MAX];
    for (place, value) in all.iter_mut().zip(degrees) {
        *place = value.to_radians();
    }
    all
}

/// Returns the model of an arm with these limits, in degrees and seconds; its jerk limit is ten times the acceleration
/// per second. It has no channels, no workspace and no impedance control.
#[must_use]
pub fn model<const N: usize>(
    arm: Arm,
    range: [[f64; 2]; N],
    velocity: [f64; N],
    acceleration: [f64; N],
) -> DeviceModel {
    DeviceModel {
        joints: N as u32,
        arm: Some(arm),
        limits: JointLimits {
            lower: radians(range.map(|[lower, _]| lower)),
            upper: radians(range.map(|[_, upper]| upper)),
            velocity_max: radians(velocity),
            acceleration_max: radians(acceleration),
            jerk_max: radians(acceleration.map(|a| 10.0 * a)),
            joints: N,
        },
        first_tolerance_rad: 1e-3,
        ..DeviceModel::NONE
    }
}

/// Returns an LWR 4+ with the limits of its robot file.
#[must_use]
pub fn lwr() -> DeviceModel {
    model(
        Arm::Srs(LWR),
        SEVEN_JOINTS,
        [110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0],
        [1200.0, 1200.0, 1600.0, 1600.0, 2500.0, 4400.0, 4400.0],
    )
}

/// Returns an LWR 4+ with the same limits for every joint: ±2.9 rad, 2 rad/s, 20 rad/s², and `jerk`, rad/s³.
#[must_use]
pub fn plain_lwr(jerk: f64) -> DeviceModel {
    DeviceModel {
        joints: 7,
        arm: Some(Arm::Srs(LWR)),
        limits: JointLimits {
            lower: [-2.9; JOINTS_MAX],
            upper: [2.9; JOINTS_MAX],
            velocity_max: [2.0; JOINTS_MAX],
            acceleration_max: [20.0; JOINTS_MAX],
            jerk_max: [jerk; JOINTS_MAX],
            joints: 7,
        },
        first_tolerance_rad: 1e-3,
        ..DeviceModel::NONE
    }
}
