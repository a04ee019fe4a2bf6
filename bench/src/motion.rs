//! What motion costs: kinematics, the path clock, each kind of motion, and nets that move one arm and two, each as something
//! to measure. Run by `cargo bench -p rcc-bench --bench motion` and by `examples/motion`; one thread.

mod cycles;
pub mod replan;

use std::hint::black_box;

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, Configuration, OrthoParallelArm, SrsArm};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;

use crate::measure::Subject;

/// Where motions begin.
const HOLD: Joints = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];
/// Positions that kinematics are measured at, one after the other: no branch of the code is foreseen by the processor.
const POSITIONS: usize = 256;
/// A wanted twist of the flange, m/s and rad/s.
pub const TWIST: [f64; 6] = [0.1, 0.05, -0.02, 0.1, 0.0, 0.2];
/// Damping of velocity kinematics.
pub const DAMPING: f64 = 0.05;

/// Subjects that belong together.
pub struct Group {
    /// Of what.
    pub name: &'static str,
    /// What is measured.
    pub subjects: Vec<Named>,
}

/// A subject with its name.
pub struct Named {
    /// One cycle of what.
    pub name: String,
    /// The longest that it may take, ns, where that was decided before it was measured.
    pub goal_ns: Option<f64>,
    /// Runs cycles.
    pub subject: Subject<'static>,
}

impl Named {
    fn new(name: impl Into<String>, mut cycle: impl FnMut() + 'static) -> Named {
        Named {
            name: name.into(),
            goal_ns: None,
            subject: Subject::new(move |cycles| (0..cycles).for_each(|_| cycle())),
        }
    }

    fn within(self, goal_ns: f64) -> Named {
        Named {
            goal_ns: Some(goal_ns),
            ..self
        }
    }
}

/// Everything, in the order of a page.
#[must_use]
pub fn groups() -> Vec<Group> {
    vec![
        kinematics("kinematics of an LWR 4+", lwr()),
        kinematics("kinematics of a KR 6 R900-2", kr6()),
        cycles::clock(),
        cycles::motions(),
        cycles::nets(),
    ]
}

/// An LWR 4+.
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

/// A pose beside where motions begin.
fn beside(x: f64, y: f64, z: f64) -> Pose {
    let start = lwr().forward(&HOLD);
    start.compose(&Pose::from_xyz_rpy([x, y, z], [0.1, 0.0, 0.0]))
}

/// In −1 to 1: a linear congruential generator (Knuth, TAOCP 2, 3.3.4, table 1, line 26).
fn random(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// A position of an arm, and what inverse kinematics are asked there.
#[derive(Clone, Copy)]
struct Place {
    joints: Joints,
    pose: Pose,
    configuration: Configuration,
}

fn places(arm: &Arm) -> Vec<Place> {
    let mut state = 7;
    let mut place = |_| {
        let joints = std::array::from_fn(|_| 2.5 * random(&mut state));
        Place {
            joints,
            pose: arm.forward(&joints),
            configuration: arm.configuration(&joints),
        }
    };
    (0..POSITIONS).map(&mut place).collect()
}

fn kinematics(name: &'static str, arm: Arm) -> Group {
    let places = places(&arm);
    let at = |name: &str, call: fn(&Arm, &Place)| {
        let places = places.clone();
        let mut next = 0;
        Named::new(name, move || {
            call(&arm, black_box(&places[next]));
            next = (next + 1) % POSITIONS;
        })
    };
    Group {
        name,
        subjects: vec![
            at("forward", |arm, place| {
                black_box(arm.forward(&place.joints));
            })
            .within(110.0),
            at("Jacobian", |arm, place| {
                black_box(arm.jacobian(&place.joints));
            }),
            at("inverse, one branch", |arm, place| {
                let Configuration { branch, arm_angle } = place.configuration;
                black_box(arm.inverse(&place.pose, arm_angle, branch, &place.joints)).ok();
            })
            .within(160.0),
            at("inverse, all branches", |arm, place| {
                let angle = place.configuration.arm_angle;
                black_box(&arm.all_branches(&place.pose, angle, &place.joints));
            }),
            at("joint velocities of a twist, damped", |arm, place| {
                black_box(arm.joint_velocities(&place.joints, &TWIST, DAMPING));
            }),
        ],
    }
}
