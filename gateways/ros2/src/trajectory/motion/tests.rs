use std::path::Path;

use rcc_config::CellConfig;

use super::*;
use crate::trajectory::messages::{ComponentTolerance, JointPoint};

fn arm() -> GoalArm {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/cells/by-joints.yaml");
    let config = CellConfig::load_offline(&file).expect("a configuration");
    let found = config
        .devices
        .iter()
        .find_map(|one| Some((one.name.clone(), one.robot.clone()?)));
    let (device, robot) = found.expect("an arm");
    GoalArm {
        joints: (1..=robot.joints.len())
            .map(|n| format!("{device}_joint_{n}"))
            .collect(),
        device,
        robot,
        period_s: 1e-3,
    }
}

fn point(positions: Vec<f64>, sec: i32) -> JointPoint {
    JointPoint {
        positions,
        time_from_start: Stamp { sec, nanosec: 0 },
        ..JointPoint::default()
    }
}

/// The first joint moves by `way` in `sec`.
fn goal(arm: &GoalArm, way: f64, sec: i32) -> Goal {
    let mut end = vec![0.0; arm.joints.len()];
    end[0] = way;
    let mut goal = Goal::default();
    goal.trajectory.joint_names.clone_from(&arm.joints);
    goal.trajectory.points = vec![point(vec![0.0; arm.joints.len()], 0), point(end, sec)];
    goal
}

fn refused(goal: &Goal, arm: &GoalArm) -> Outcome {
    let refused = GoalMotion::of(goal, arm).and_then(|motion| motion.net(arm, "x", None));
    refused.expect_err("it is refused").0
}

#[test]
fn the_order_of_the_names_has_no_meaning_and_those_of_the_robot_are_known() {
    let arm = arm();
    let straight = goal(&arm, 0.2, 2);
    let motion = GoalMotion::of(&straight, &arm).expect("a motion");
    let mut turned = straight.clone();
    let of_robot = arm.robot.joints.iter().map(|joint| joint.name.clone());
    turned.trajectory.joint_names = of_robot.rev().collect();
    for point in &mut turned.trajectory.points {
        point.positions.reverse();
    }
    assert_eq!(GoalMotion::of(&turned, &arm), Ok(motion.clone()));
    let net = motion.net(&arm, "goal", None).expect("a net");
    assert_eq!(net.duration_s, 2.0);
    assert_eq!(net.end[0], 0.2);
    assert!(net.text.starts_with("net: goal\n"), "{}", net.text);
}

#[test]
fn a_limit_that_is_passed_is_named() {
    let arm = arm();
    let outcome = refused(&goal(&arm, 2.0, 1), &arm);
    assert_eq!(outcome.error_code, code::INVALID_GOAL);
    let words = outcome.error_string;
    assert!(
        words.contains("_joint_1 at ") && words.contains("exceeds"),
        "{words}"
    );
    assert!(words.contains("times as slow it keeps them"), "{words}");
}

#[test]
fn what_a_net_could_not_keep_is_refused() {
    let arm = arm();
    let change = |change: &dyn Fn(&mut Goal)| {
        let mut goal = goal(&arm, 0.2, 2);
        change(&mut goal);
        refused(&goal, &arm)
    };
    let tolerance = |name: &str, velocity| JointTolerance {
        name: name.to_owned(),
        velocity,
        ..JointTolerance::default()
    };
    let first = arm.joints[0].as_str();
    let cases = [
        (
            change(&|goal| goal.trajectory.header.stamp.sec = 1),
            code::OLD_HEADER_TIMESTAMP,
        ),
        (
            change(&|goal| goal.trajectory.header.stamp.sec = i32::MAX),
            code::INVALID_GOAL,
        ),
        (
            change(&|goal| goal.multi_dof_trajectory.joint_names.push("base".into())),
            code::INVALID_GOAL,
        ),
        (
            change(&|goal| {
                goal.component_goal_tolerance
                    .push(ComponentTolerance::default())
            }),
            code::INVALID_GOAL,
        ),
        (
            change(&|goal| goal.path_tolerance.push(tolerance(first, 0.1))),
            code::INVALID_GOAL,
        ),
        (
            change(&|goal| goal.goal_tolerance.push(tolerance("wrist", 0.0))),
            code::INVALID_JOINTS,
        ),
        (
            change(&|goal| goal.trajectory.joint_names[0] = "wrist".into()),
            code::INVALID_JOINTS,
        ),
        (
            change(&|goal| goal.trajectory.points.clear()),
            code::INVALID_GOAL,
        ),
        (
            change(&|goal| goal.trajectory.points[1].positions[0] = f64::NAN),
            code::INVALID_GOAL,
        ),
        (
            change(&|goal| goal.trajectory.points.truncate(1)),
            code::INVALID_GOAL,
        ),
    ];
    for (number, (outcome, code)) in cases.into_iter().enumerate() {
        assert_eq!(
            outcome.error_code, code,
            "{number}: {}",
            outcome.error_string
        );
        assert!(!outcome.error_string.is_empty(), "{number}");
    }
}

#[test]
fn a_first_point_after_the_start_begins_where_the_arm_rests() {
    let arm = arm();
    let mut later = goal(&arm, 0.2, 2);
    later.trajectory.points.remove(0);
    let motion = GoalMotion::of(&later, &arm).expect("a motion");
    assert!(motion.begins_at_rest_position());
    let rest = vec![0.1; arm.joints.len()];
    assert!(motion.net(&arm, "goal", Some(&rest)).is_ok());
    assert!(motion.net(&arm, "goal", None).is_err());
}

#[test]
fn a_tolerance_of_zero_or_less_is_none() {
    let arm = arm();
    let mut goal = goal(&arm, 0.2, 2);
    let tolerance = |place: usize, position| JointTolerance {
        name: arm.joints[place].clone(),
        position,
        ..JointTolerance::default()
    };
    goal.goal_tolerance = vec![tolerance(0, 0.01), tolerance(1, 0.0), tolerance(2, -1.0)];
    let motion = GoalMotion::of(&goal, &arm).expect("a motion");
    assert_eq!(
        &motion.goal_tolerance[..3],
        [0.01, f64::INFINITY, f64::INFINITY]
    );
}
