//! Status and Turn of a six-axis arm in the middle of a sequence, judged by the joints that come out.

use rcc_core::frame::{DeviceModel, PrepareFault};
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::path::{
    Leg, MotionBuilder, MotionFault, MotionState, Motions, PathRequest, PathSegment, SpeedOverride,
    SpeedProfile,
};
use rcc_core::pose::Pose;
use rcc_testing::arms::{self, lwr};

use crate::MotionSetBuilder;

/// Elbow up, the tool in front of the arm.
const START: Joints = [0.2, -1.4, 1.7, 0.1, 1.0, -0.3, 0.0, 0.0];
/// Where the `ptp` of the sequence goes to, as some joints reach it.
const GOAL: Joints = [0.4, -1.2, 1.4, 0.5, 0.9, -0.2, 0.0, 0.0];

/// The KR 6 R900-2; velocities as in its data sheet.
fn kr6() -> DeviceModel {
    arms::model(
        Arm::OrthoParallel(arms::KR6),
        arms::SIX_JOINTS,
        [360.0, 300.0, 360.0, 381.0, 388.0, 615.0],
        [2000.0; 6],
    )
}

fn arm() -> Arm {
    kr6().arm.unwrap()
}

/// A line, a `ptp` to the pose of [`GOAL`] with this Status and Turn, and a line from there; the states at the ends of
/// legs.
fn sequence(status: Option<u8>, turn: Option<u8>) -> Result<[MotionState; 3], MotionFault> {
    let goal = arm().forward(&GOAL);
    let beside = |pose: &Pose, z| pose.compose(&Pose::from_xyz_rpy([0.0, 0.02, z], [0.0; 3]));
    let ptp = PathSegment::JointsToPose {
        to: goal,
        branch: None,
        status,
        turn,
    };
    let first = beside(&arm().forward(&START), 0.02);
    let last = beside(&goal, -0.03);
    let legs = [
        PathSegment::Line { to: first },
        ptp,
        PathSegment::Line { to: last },
    ];
    let legs = legs.map(Leg::new);
    let (models, holds) = ([kr6()], [Some(START)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, 1e-3, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs: &legs,
        pace: SpeedProfile::Uniform,
    };
    builder.path(0, &request).map_err(|refused| match refused {
        PrepareFault::Motion { leg: 1, fault, .. } => fault,
        other => panic!("{other:?}"),
    })?;
    let mut set = builder.finish().unwrap();
    let mut ends: Vec<MotionState> = Vec::new();
    for _ in 0..20_000 {
        let state = set.step(0, SpeedOverride::RUN).unwrap();
        let leg = state.leg as usize;
        ends.truncate(leg + 1);
        if ends.len() > leg {
            ends[leg] = state;
        } else {
            ends.push(state);
        }
        if state.path.done {
            assert!(state.pose.distance_to(&last) < 1e-9);
            return Ok(ends.try_into().unwrap());
        }
    }
    panic!("never done: {:?}", ends.last())
}

fn near(joints: &Joints, want: &Joints) -> bool {
    let pairs = joints.iter().zip(want).take(6);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 0.01
}

#[test]
fn turn_says_which_of_two_turns_of_a_joint_it_ends_at() {
    let turn = arm().turn(&GOAL);
    let [_, there, _] = sequence(arm().status(&GOAL), Some(turn)).unwrap();
    assert!(near(&there.joints, &GOAL), "{:?}", there.joints);
    // A6 positive: nearly a whole turn further.
    let [_, there, last] = sequence(arm().status(&GOAL), Some(turn & !(1 << 5))).unwrap();
    let mut other = GOAL;
    other[5] += core::f64::consts::TAU;
    assert!(near(&there.joints, &other), "{:?}", there.joints);
    assert!(last.joints[5] > 5.0, "the line continues from there");
}

#[test]
fn status_says_the_branch_and_the_next_line_stays_in_it() {
    let pi = core::f64::consts::PI;
    let [a, b, c, d, e, f, ..] = GOAL;
    let flipped = [a, b, c, d - pi, -e, f + pi, 0.0, 0.0];
    let same = arm().forward(&flipped).distance_to(&arm().forward(&GOAL));
    assert!(same < 1e-12);
    let status = arm().status(&flipped);
    assert_ne!(status, arm().status(&GOAL));
    let ends = sequence(status, Some(arm().turn(&flipped))).unwrap();
    assert_eq!(arm().status(&ends[0].joints), arm().status(&START));
    assert!(near(&ends[1].joints, &flipped), "{:?}", ends[1].joints);
    assert_eq!(arm().branch(&ends[2].joints), arm().branch(&flipped));
    // Without both it is where it is soonest: in the branch of the start.
    let [_, soonest, _] = sequence(None, None).unwrap();
    assert!(near(&soonest.joints, &GOAL), "{:?}", soonest.joints);
}

#[test]
fn a_status_is_refused_by_an_arm_of_seven_joints() {
    let (hold, model) = (START, lwr());
    let goal = model.arm.unwrap().forward(&hold);
    let legs = [Leg::new(PathSegment::JointsToPose {
        to: goal,
        branch: None,
        status: Some(2),
        turn: None,
    })];
    let (models, holds) = ([model], [Some(hold)]);
    let request = PathRequest {
        device: 0,
        from: None,
        legs: &legs,
        pace: SpeedProfile::Uniform,
    };
    let refused = MotionSetBuilder::new(&models, &holds, 1e-3, 1).path(0, &request);
    assert!(
        matches!(
            refused,
            Err(PrepareFault::Motion {
                fault: MotionFault::NoStatus,
                ..
            })
        ),
        "{refused:?}"
    );
}

#[test]
fn a_turn_beyond_the_range_of_a_joint_is_refused_with_it() {
    // A1 negative: 0.4 - 2π.
    let turn = arm().turn(&GOAL) | 1;
    let fault = sequence(arm().status(&GOAL), Some(turn)).unwrap_err();
    assert!(
        matches!(fault, MotionFault::JointRange { joint: 0, value, .. } if value < -5.0),
        "{fault:?}"
    );
}
