//! How a goal ends: state and result from the end of its net. Pure.

use rcc_api::bodies::CommandView;
use ros2_client::action_msgs::GoalStatusEnum;

use crate::trajectory::messages::{Outcome, code};
use crate::trajectory::starter::StartedGoal;

/// State and result of a goal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ending {
    pub status: GoalStatusEnum,
    pub outcome: Outcome,
}

/// A goal whose net has ended.
pub(super) struct EndedGoal<'a> {
    /// A client has asked for CANCEL.
    pub is_canceled: bool,
    /// The deviation from the path for which it was canceled.
    pub violation: Option<&'a str>,
    pub started: &'a StartedGoal,
    /// Where the arm is, rad; `None`: its driver does not answer.
    pub position: Option<&'a [f64]>,
}

fn ending(status: GoalStatusEnum, error_code: i32, words: impl Into<String>) -> Ending {
    Ending {
        status,
        outcome: Outcome {
            error_code,
            error_string: words.into(),
        },
    }
}

/// Another goal has taken the arm.
pub(super) fn replaced() -> Ending {
    ending(
        GoalStatusEnum::Canceled,
        code::SUCCESSFUL,
        "replaced by a new goal",
    )
}

/// A client has canceled it before it moved the arm.
pub(super) fn not_started() -> Ending {
    ending(
        GoalStatusEnum::Canceled,
        code::SUCCESSFUL,
        "canceled before it was started",
    )
}

/// Nobody knows the net any more: the executor was restarted, or somebody unloaded it.
pub(super) fn gone(words: &str) -> Ending {
    ending(
        GoalStatusEnum::Aborted,
        code::PATH_TOLERANCE_VIOLATED,
        words,
    )
}

/// Returns the ending of a goal.
pub(super) fn of(view: &CommandView, goal: &EndedGoal<'_>) -> Ending {
    let words = view.words.clone().unwrap_or_default();
    if let Some(violation) = goal.violation {
        return ending(
            GoalStatusEnum::Aborted,
            code::PATH_TOLERANCE_VIOLATED,
            violation,
        );
    }
    match view.reason.as_deref() {
        Some("finished") => arrived(goal),
        Some("canceled") if goal.is_canceled => ending(
            GoalStatusEnum::Canceled,
            code::SUCCESSFUL,
            "stopped on its path",
        ),
        Some("canceled") => ending(
            GoalStatusEnum::Aborted,
            code::PATH_TOLERANCE_VIOLATED,
            "stopped on its path: the net was canceled at the cell",
        ),
        _ => ending(
            GoalStatusEnum::Aborted,
            code::PATH_TOLERANCE_VIOLATED,
            words,
        ),
    }
}

fn arrived(goal: &EndedGoal<'_>) -> Ending {
    let tolerance = &goal.started.motion.goal_tolerance;
    let is_asked = tolerance.iter().any(|one| one.is_finite());
    let violation = match goal.position {
        Some(position) => {
            let errors = goal.started.end.iter().zip(position);
            let errors: Vec<f64> = errors.map(|(end, position)| end - position).collect();
            violation(&goal.started.joints, &errors, tolerance)
        }
        None => {
            is_asked.then(|| "the driver does not answer, so its position is not known".to_owned())
        }
    };
    match violation {
        None => ending(GoalStatusEnum::Succeeded, code::SUCCESSFUL, ""),
        Some(words) => ending(
            GoalStatusEnum::Aborted,
            code::GOAL_TOLERANCE_VIOLATED,
            words,
        ),
    }
}

/// Returns which joint deviates by more than its tolerance (rad), and by how much.
pub(super) fn violation(joints: &[String], errors: &[f64], tolerance: &[f64]) -> Option<String> {
    let rows = joints.iter().zip(errors).zip(tolerance);
    let beyond = |((_, error), most): &((&String, &f64), &f64)| error.abs() > **most;
    let rows = rows.filter(beyond).map(|((joint, error), most)| {
        format!(
            "{joint} deviates by {:.5} rad, the tolerance is {most} rad",
            error.abs()
        )
    });
    let rows: Vec<String> = rows.collect();
    (!rows.is_empty()).then(|| rows.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deviation_names_joint_value_and_tolerance() {
        let joints = ["a".to_owned(), "b".to_owned()];
        assert_eq!(
            violation(&joints, &[0.1, -0.2], &[f64::INFINITY, 0.3]),
            None
        );
        let words = violation(&joints, &[0.1, -0.4], &[f64::INFINITY, 0.3]);
        let wanted = "b deviates by 0.40000 rad, the tolerance is 0.3 rad";
        assert_eq!(words.as_deref(), Some(wanted));
    }
}
