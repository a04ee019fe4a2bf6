//! Motions of arms by their joints: goals far away, the redundant joint, and what they refuse. Tests only.

use rcc_core::frame::{DeviceModel, PrepareFault};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::{
    ElbowMotion, Leg, MotionBuilder, MotionFault, MotionState, Motions, PathRequest, PathSegment,
    SpeedOverride, SpeedProfile,
};
use rcc_core::pose::Pose;
use rcc_testing::{Random, Rng, arms};

use crate::MotionSetBuilder;

/// Runs one leg from `hold` to its end.
fn run(model: DeviceModel, hold: Joints, leg: Leg<'_>) -> Result<MotionState, MotionFault> {
    let (models, holds) = ([model], [Some(hold)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, 1e-3, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs: &[leg],
        pace: SpeedProfile::Uniform,
    };
    builder.path(0, &request).map_err(|refused| match refused {
        PrepareFault::Motion { fault, .. } => fault,
        other => panic!("{other:?}"),
    })?;
    let mut set = builder.finish().unwrap();
    for _ in 0..60_000 {
        let state = set.step(0, SpeedOverride::RUN).unwrap();
        if state.path.done {
            return Ok(state);
        }
    }
    panic!("never done")
}

fn to_pose(to: Pose) -> PathSegment<'static> {
    PathSegment::JointsToPose {
        to,
        branch: None,
        status: None,
        turn: None,
    }
}

#[test]
fn a_joint_motion_reaches_poses_all_over_the_range() {
    const GOALS: usize = 100;
    for (model, hold) in [
        (arms::ur5e_model(), arms::UR_HOLD),
        (arms::panda_model(), arms::PANDA_HOLD),
    ] {
        let arm = model.arm.unwrap();
        let mut random = Rng::with_seed(3);
        let mut reached = 0;
        for _ in 0..GOALS {
            let mut joints = [0.0; JOINTS_MAX];
            for (index, joint) in joints.iter_mut().enumerate().take(model.limits.joints) {
                *joint = random.uniform(model.limits.lower[index], model.limits.upper[index]);
            }
            let goal = arm.forward(&joints);
            let Ok(end) = run(model, hold, Leg::new(to_pose(goal))) else {
                continue;
            };
            reached += 1;
            let found = arm.forward(&end.joints);
            assert!(found.distance_to(&goal) < 1e-9 && found.angle_to(&goal) < 1e-9);
        }
        println!("{reached} of {GOALS}");
        assert!(reached >= 97, "{reached}");
    }
}

#[test]
fn the_pose_of_the_start_needs_no_motion() {
    let model = arms::panda_model();
    let goal = model.arm.unwrap().forward(&arms::PANDA_HOLD);
    let end = run(model, arms::PANDA_HOLD, Leg::new(to_pose(goal))).unwrap();
    for (end, hold) in end.joints.iter().zip(arms::PANDA_HOLD) {
        assert!((end - hold).abs() < 1e-12);
    }
}

#[test]
fn the_redundant_joint_stays_on_a_line_or_moves_to_its_goal() {
    let model = arms::panda_model();
    let from = model.arm.unwrap().forward(&arms::PANDA_HOLD);
    let to = from.compose(&Pose::from_xyz_rpy([0.05, 0.05, -0.05], [0.0; 3]));
    let line = Leg::new(PathSegment::Line { to });
    let end = run(model, arms::PANDA_HOLD, line).unwrap();
    assert_eq!(end.joints[2], arms::PANDA_HOLD[2]);
    let turned = Leg {
        elbow: ElbowMotion::To(-0.3),
        ..line
    };
    let end = run(model, arms::PANDA_HOLD, turned).unwrap();
    assert!((end.joints[2] + 0.3).abs() < 1e-12);
    assert!(model.arm.unwrap().forward(&end.joints).distance_to(&to) < 1e-9);
    let middle = Leg {
        elbow: ElbowMotion::Middle,
        ..line
    };
    let refused = run(model, arms::PANDA_HOLD, middle).unwrap_err();
    assert_eq!(refused, MotionFault::NoArmAngle);
}

#[test]
fn branch_and_status_are_refused() {
    let goal = arms::ur5e().forward(&arms::UR_HOLD);
    for (branch, status, wanted) in [
        (Some(0), None, MotionFault::NoBranch),
        (None, Some(2), MotionFault::NoStatus),
    ] {
        let leg = Leg::new(PathSegment::JointsToPose {
            to: goal,
            branch,
            status,
            turn: None,
        });
        let refused = run(arms::ur5e_model(), arms::UR_HOLD, leg).unwrap_err();
        assert_eq!(refused, wanted);
    }
}

#[test]
fn three_axes_follow_a_line_in_their_plane_and_no_other() {
    let model = arms::model(
        rcc_core::kinematics::Arm::Serial(arms::planar()),
        [[-170.0, 170.0]; 3],
        [180.0; 3],
        [600.0; 3],
    );
    let hold = [0.3, 0.8, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    let from = model.arm.unwrap().forward(&hold);
    let line = |way, turn| {
        Leg::new(PathSegment::Line {
            to: from.compose(&Pose::from_xyz_rpy(way, turn)),
        })
    };
    let end = run(model, hold, line([-0.05, 0.1, 0.0], [0.0, 0.0, 0.3])).unwrap();
    assert!(end.joints[3..].iter().all(|joint| *joint == 0.0));
    let up = run(model, hold, line([0.0, 0.0, 0.01], [0.0; 3])).unwrap_err();
    assert!(matches!(up, MotionFault::Unreachable { .. }), "{up:?}");
    let tilted = run(model, hold, line([0.0; 3], [0.1, 0.0, 0.0])).unwrap_err();
    assert!(
        matches!(tilted, MotionFault::Unreachable { .. }),
        "{tilted:?}"
    );
}
