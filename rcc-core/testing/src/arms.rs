//! The arms of tests and benchmarks. `rcc-core` includes this file in its unit tests, for which the types of the
//! package `rcc-testing` would be those of another build of `rcc-core`.

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, OrthoParallelArm, SrsArm};
use rcc_core::message::{JOINTS_MAX, Joints};

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
