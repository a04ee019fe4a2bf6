//! The arms that a Sunrise Cabinet moves: lengths, masses, and the limits that it supervises.
//! Plain data.

use super::Joints;
use crate::sim::arm::command_stream::SupervisedLimits;
use crate::sim::arm::model::ArmModel;

/// Greatest supervised acceleration, as a multiple of the greatest velocity, 1/s. The value is ours: KUKA publishes none.
const ACCELERATION_RATE: f64 = 10.0;

/// An arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ArmKind {
    /// LBR iiwa 7 R800.
    Iiwa7,
    /// LBR iiwa 14 R820.
    Iiwa14,
    /// LBR Med 7 R800.
    Med7,
    /// LBR Med 14 R820.
    Med14,
}

const TWIST_SINE: Joints = [-1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 0.0];
/// Our own values: an LBR measures torques behind its gears, where little friction is left.
const FRICTION: Joints = [0.4, 0.4, 0.2, 0.2, 0.2, 0.1, 0.1];

/// Centres of mass of the R800, base frame, upright.
const CENTRE_R800: [[f64; 3]; 7] = [
    [0.0, -0.034_819, 0.270_799],
    [0.0, 0.029_293, 0.426_944],
    [0.0, 0.034_819, 0.670_799],
    [0.0, -0.029_293, 0.826_944],
    [0.0, -0.029_824, 1.023_767],
    [0.0, 0.000_320, 1.144_950],
    [0.0, 0.0, 1.244_782],
];

/// Lengths: data sheet. Masses and centres: the URDF of lbr_fri_ros2_stack; KUKA publishes none. The radius, which
/// stands for the moments of inertia, is ours.
const IIWA_7: ArmModel = ArmModel {
    offset: [0.340, 0.0, 0.400, 0.0, 0.400, 0.0, 0.126],
    twist_sine: TWIST_SINE,
    mass: [
        3.394_011, 4.031_991, 3.394_011, 4.031_989, 1.529_239, 2.403_626, 0.259_474,
    ],
    centre: CENTRE_R800,
    radius: 0.08,
    friction: FRICTION,
    damping: FRICTION,
};

/// As [`IIWA_7`].
const MED_7: ArmModel = ArmModel {
    mass: [
        3.271_492, 3.886_440, 3.271_492, 3.886_439, 1.474_035, 2.316_917, 0.250_107,
    ],
    ..IIWA_7
};

/// As [`IIWA_7`]; the Med 14 is taken to weigh the same.
const IIWA_14: ArmModel = ArmModel {
    offset: [0.360, 0.0, 0.420, 0.0, 0.400, 0.0, 0.126],
    mass: [
        5.281_174, 5.079_432, 4.081_118, 3.521_230, 2.176_916, 2.324_906, 0.395_984,
    ],
    centre: [
        [0.0, -0.033_795, 0.279_904],
        [0.000_152, 0.041_987, 0.418_801],
        [0.0, 0.029_564, 0.691_004],
        [0.0, -0.034_264, 0.847_419],
        [-0.000_120, -0.021_390, 1.039_975],
        [0.0, 0.000_338, 1.180_566],
        [0.0, 0.0, 1.278_287],
    ],
    ..IIWA_7
};

impl ArmKind {
    /// Returns lengths and masses.
    #[must_use]
    pub fn model(self) -> &'static ArmModel {
        match self {
            ArmKind::Iiwa7 => &IIWA_7,
            ArmKind::Med7 => &MED_7,
            ArmKind::Iiwa14 | ArmKind::Med14 => &IIWA_14,
        }
    }

    /// Returns the limits of commanded positions: positions and velocities as others publish them from KUKA's data
    /// sheets (the Med has those of the iiwa); the accelerations are ours.
    #[must_use]
    pub fn limits(self) -> SupervisedLimits {
        let velocity: Joints = match self {
            ArmKind::Iiwa7 | ArmKind::Med7 => [98.0, 98.0, 100.0, 130.0, 140.0, 180.0, 180.0],
            ArmKind::Iiwa14 | ArmKind::Med14 => [85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0],
        };
        let velocity = velocity.map(f64::to_radians);
        SupervisedLimits {
            position: [170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0].map(f64::to_radians),
            velocity,
            acceleration: velocity.map(|velocity| velocity * ACCELERATION_RATE),
        }
    }

    /// Returns the greatest torques of the joints, N·m, from the data sheets.
    #[must_use]
    pub fn torques(self) -> Joints {
        match self {
            ArmKind::Iiwa7 | ArmKind::Med7 => [176.0, 176.0, 110.0, 110.0, 110.0, 40.0, 40.0],
            ArmKind::Iiwa14 | ArmKind::Med14 => [320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::arm::model::geometry;

    #[test]
    fn the_flange_is_where_other_peoples_kinematics_have_it() {
        let q = [0.1, 0.5, -0.3, 1.2, 0.4, -0.7, 0.9];
        for (kind, expected) in [
            (ArmKind::Iiwa7, [-0.184_749, 0.096_565, 1.016_506]),
            (ArmKind::Med14, [-0.175_208, 0.097_522, 1.054_057]),
        ] {
            let found = geometry(kind.model(), &q).position;
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-6, "{kind:?} {found}");
            }
        }
    }

    #[test]
    fn the_model_is_that_of_the_robots_file() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/robots");
        for (kind, file) in [
            (ArmKind::Iiwa7, "iiwa7.yaml"),
            (ArmKind::Iiwa14, "iiwa14.yaml"),
            (ArmKind::Med7, "med7.yaml"),
            (ArmKind::Med14, "med14.yaml"),
        ] {
            let path = format!("{folder}/{file}");
            let text = std::fs::read_to_string(&path).expect("a robot's file");
            let robot = rcc_config::RobotConfig::parse(&text, &path);
            let robot = robot.unwrap_or_else(|faults| panic!("{faults}"));
            let limits = kind.limits();
            for (joint, config) in robot.joints.iter().enumerate() {
                let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
                let name = format!("{file} A{}", joint + 1);
                assert!(close(config.upper_rad, limits.position[joint]), "{name}");
                assert!(
                    close(config.velocity_rad_s, limits.velocity[joint]),
                    "{name}"
                );
                assert!(
                    config.acceleration_rad_s2 < limits.acceleration[joint],
                    "{name}"
                );
            }
        }
    }
}
