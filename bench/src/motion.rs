//! Benchmark subjects of motion: kinematics, the path clock, each kind of motion, and nets that move one arm and two.
//! Used by `cargo bench -p rcc-bench --bench motion` and by `examples/motion`; one thread.

mod cycles;
pub mod replan;

use std::hint::black_box;

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, ArmConfiguration, OrthoParallelArm, SrsArm};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;

use crate::measure::MeasuredSubject;

/// Start position of the motions, rad.
const HOLD: Joints = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];
/// Number of positions at which kinematics are measured in turn, so that the processor cannot predict branches.
const POSITIONS: usize = 256;
/// Twist of the flange, m/s and rad/s.
pub const TWIST: [f64; 6] = [0.1, 0.05, -0.02, 0.1, 0.0, 0.2];
/// Damping of the velocity kinematics.
pub const DAMPING: f64 = 0.05;

/// A group of related subjects.
pub struct SubjectGroup {
    /// Title of the group.
    pub name: &'static str,
    /// The subjects.
    pub subjects: Vec<NamedSubject>,
}

/// A subject with its name and goal.
pub struct NamedSubject {
    /// What one cycle does.
    pub name: String,
    /// Maximum duration that was set as a goal before it was measured, ns.
    pub goal_ns: Option<f64>,
    /// Runs the cycles.
    pub subject: MeasuredSubject<'static>,
}

impl NamedSubject {
    fn new(name: impl Into<String>, mut cycle: impl FnMut() + 'static) -> NamedSubject {
        NamedSubject {
            name: name.into(),
            goal_ns: None,
            subject: MeasuredSubject::new(move |cycles| (0..cycles).for_each(|_| cycle())),
        }
    }

    fn within(self, goal_ns: f64) -> NamedSubject {
        NamedSubject {
            goal_ns: Some(goal_ns),
            ..self
        }
    }
}

/// Returns all groups, in the order of the report.
#[must_use]
pub fn groups() -> Vec<SubjectGroup> {
    vec![
        kinematics("kinematics of an LWR 4+", lwr()),
        kinematics("kinematics of a KR 6 R900-2", kr6()),
        cycles::clock(),
        cycles::motions(),
        cycles::nets(),
    ]
}

/// Returns the kinematics of an LWR 4+.
#[must_use]
pub fn lwr() -> Arm {
    Arm::Srs(SrsArm {
        shoulder_height: 0.3105,
        upper_arm: 0.4,
        forearm: 0.39,
        wrist_to_flange: 0.078,
        signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
    })
}

/// A KR 6 R900-2.
fn kr6() -> Arm {
    Arm::OrthoParallel(OrthoParallelArm {
        shoulder_height: 0.4,
        shoulder_offset: 0.025,
        lateral_offset: 0.0,
        upper_arm: 0.455,
        elbow_offset: -0.025,
        forearm: 0.42,
        wrist_to_flange: 0.09,
        signs: [-1.0, 1.0, 1.0, -1.0, 1.0, -1.0],
        zeros: [0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0, 0.0],
    })
}

/// The LWR 4+ as a device, with limits that the motions here keep.
fn model() -> DeviceModel {
    DeviceModel {
        joints: 7,
        arm: Some(lwr()),
        limits: JointLimits {
            lower: [-2.9; 8],
            upper: [2.9; 8],
            velocity_max: [2.0; 8],
            acceleration_max: [20.0; 8],
            jerk_max: [200.0; 8],
            joints: 7,
        },
        first_tolerance_rad: 1e-3,
        ..DeviceModel::NONE
    }
}

/// Returns a pose relative to the start pose, in the flange's frame: offset by `x`, `y`, `z`, m, and rotated by 0.1 rad.
fn offset_from_start(x: f64, y: f64, z: f64) -> Pose {
    let start = lwr().forward(&HOLD);
    start.compose(&Pose::from_xyz_rpy([x, y, z], [0.1, 0.0, 0.0]))
}

/// Returns a pseudo-random number in −1 to 1: a linear congruential generator (Knuth, TAOCP 2, 3.3.4, table 1, line
/// 26).
fn random(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// A position of an arm, with the inputs of its inverse kinematics.
#[derive(Clone, Copy)]
struct ArmSample {
    joints: Joints,
    pose: Pose,
    configuration: ArmConfiguration,
}

fn samples(arm: &Arm) -> Vec<ArmSample> {
    let mut state = 7;
    let mut sample = |_| {
        let joints = std::array::from_fn(|_| 2.5 * random(&mut state));
        ArmSample {
            joints,
            pose: arm.forward(&joints),
            configuration: arm.configuration(&joints),
        }
    };
    (0..POSITIONS).map(&mut sample).collect()
}

fn kinematics(name: &'static str, arm: Arm) -> SubjectGroup {
    let samples = samples(&arm);
    let at = |name: &str, call: fn(&Arm, &ArmSample)| {
        let samples = samples.clone();
        let mut next = 0;
        NamedSubject::new(name, move || {
            call(&arm, black_box(&samples[next]));
            next = (next + 1) % POSITIONS;
        })
    };
    SubjectGroup {
        name,
        subjects: vec![
            at("forward", |arm, sample| {
                black_box(arm.forward(&sample.joints));
            })
            .within(110.0),
            at("Jacobian", |arm, sample| {
                black_box(arm.jacobian(&sample.joints));
            }),
            at("inverse, one branch", |arm, sample| {
                let ArmConfiguration { branch, arm_angle } = sample.configuration;
                black_box(arm.inverse(&sample.pose, arm_angle, branch, &sample.joints)).ok();
            })
            .within(160.0),
            at("inverse, all branches", |arm, sample| {
                let angle = sample.configuration.arm_angle;
                black_box(&arm.all_branches(&sample.pose, angle, &sample.joints));
            }),
            at("joint velocities of a twist, damped", |arm, sample| {
                black_box(arm.joint_velocities(&sample.joints, &TWIST, DAMPING));
            }),
        ],
    }
}
