//! Benchmark subjects of motion: kinematics, the path clock, each kind of motion, and nets that move one arm and two.
//! Used by `cargo bench -p rcc-bench --bench motion` and by `examples/motion`; one thread.

mod cycles;
pub mod replan;

use std::hint::black_box;

use rcc_core::frame::DeviceModel;
use rcc_core::kinematics::{Arm, ArmConfiguration};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_testing::arms::{HOLD, KR6, LWR, plain_lwr};
use rcc_testing::{Random, Rng};

use crate::measure::MeasuredSubject;

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
    /// Name of the work of one cycle.
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
        kinematics("kinematics of an LWR 4+", Arm::Srs(LWR)),
        kinematics("kinematics of a KR 6 R900-2", Arm::OrthoParallel(KR6)),
        cycles::clock(),
        cycles::motions(),
        cycles::nets(),
    ]
}

/// The LWR 4+ as a device, with limits that the motions here keep.
fn model() -> DeviceModel {
    plain_lwr(200.0)
}

/// Returns a pose relative to the start pose, in the flange's frame: offset by `x`, `y`, `z`, m, and rotated by 0.1 rad.
fn offset_from_start(x: f64, y: f64, z: f64) -> Pose {
    let start = Arm::Srs(LWR).forward(&HOLD);
    start.compose(&Pose::from_xyz_rpy([x, y, z], [0.1, 0.0, 0.0]))
}

/// A position of an arm, with the inputs of its inverse kinematics.
#[derive(Clone, Copy)]
struct ArmSample {
    joints: Joints,
    pose: Pose,
    configuration: ArmConfiguration,
}

fn samples(arm: &Arm) -> Vec<ArmSample> {
    let mut random = Rng::with_seed(7);
    let mut sample = |_| {
        let joints = std::array::from_fn(|_| random.uniform(-2.5, 2.5));
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
