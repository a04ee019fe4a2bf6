//! A goal as a motion of an arm: its joints, its tolerances, and the net that follows it. Pure.

use rcc_config::{JointConfig, RobotConfig};
use rcc_trajectory::{
    Brake, Excess, JointTrajectory, NetParts, PathError, TrajectoryPath, excesses, read, stretch,
    text,
};

use crate::trajectory::messages::{Goal, JointTolerance, Outcome, Stamp, code};

/// The arm that a goal is for.
#[derive(Clone, Debug)]
pub struct GoalArm {
    /// Name of the device.
    pub device: String,
    /// Names of its joints in `/joint_states`.
    pub joints: Vec<String>,
    /// Its robot.
    pub robot: RobotConfig,
    /// Period of the cell, s.
    pub period_s: f64,
}

/// Why a goal is refused; it becomes the result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal(pub Outcome);

impl Refusal {
    /// Makes a refusal with a code of `control_msgs`.
    pub fn new(error_code: i32, words: impl Into<String>) -> Refusal {
        Refusal(Outcome {
            error_code,
            error_string: words.into(),
        })
    }

    /// Makes one with INVALID_GOAL.
    pub fn invalid(words: impl Into<String>) -> Refusal {
        Refusal::new(code::INVALID_GOAL, words)
    }
}

/// A goal that is understood.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalMotion {
    /// In the order of the arm's joints.
    trajectory: JointTrajectory,
    /// Greatest deviation while it moves, rad, for each joint; infinite: none is asked for.
    pub path_tolerance: Vec<f64>,
    /// Greatest deviation at the end, rad, for each joint; infinite: none is asked for.
    pub goal_tolerance: Vec<f64>,
}

/// The net that follows a goal.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalNet {
    /// Its text.
    pub text: String,
    /// Duration, s.
    pub duration_s: f64,
    /// Positions at the end, rad.
    pub end: Vec<f64>,
}

impl GoalMotion {
    /// Reads a goal for an arm.
    ///
    /// # Errors
    /// Refuses what a net could not keep: other joints, a start time, joints with several degrees of freedom, tolerances of
    /// velocities on the path; and whatever `import trajectory` refuses in a message.
    pub fn of(goal: &Goal, arm: &GoalArm) -> Result<GoalMotion, Refusal> {
        refuse_other_parts(goal)?;
        let message = serde_json::to_string(&goal.trajectory);
        let message = message.map_err(|error| Refusal::invalid(error.to_string()))?;
        let mut trajectory = read(&message).map_err(|faults| {
            let words = faults.iter().map(|fault| match &fault.help {
                Some(help) => format!("{} ({help})", fault.message),
                None => fault.message.clone(),
            });
            Refusal::invalid(words.collect::<Vec<_>>().join("; "))
        })?;
        let order = order(&trajectory.joints, arm)?;
        let sorted = |values: &[f64]| -> Vec<f64> {
            order
                .iter()
                .filter_map(|place| values.get(*place).copied())
                .collect()
        };
        trajectory.joints.clone_from(&arm.joints);
        for point in &mut trajectory.points {
            point.positions = sorted(&point.positions);
            for values in [&mut point.velocities, &mut point.accelerations] {
                *values = values.as_ref().map(|values| sorted(values));
            }
        }
        Ok(GoalMotion {
            trajectory,
            path_tolerance: tolerances(&goal.path_tolerance, arm)?,
            goal_tolerance: tolerances(&goal.goal_tolerance, arm)?,
        })
    }

    /// Returns true if the first point is later than the start: the motion begins where the arm rests.
    #[must_use]
    pub fn begins_at_rest_position(&self) -> bool {
        self.trajectory
            .points
            .first()
            .is_some_and(|point| point.time_s > 0.0)
    }

    /// Returns the net of this name; `start` (rad) if the motion begins where the arm rests.
    ///
    /// # Errors
    /// Refuses a trajectory that does not begin and end at rest, or that passes a limit of the robot.
    pub fn net(
        &self,
        arm: &GoalArm,
        name: &str,
        start: Option<&[f64]>,
    ) -> Result<GoalNet, Refusal> {
        let path = TrajectoryPath::new(&self.trajectory, start, 1.0);
        let path = path.map_err(|error| Refusal::invalid(not_a_motion(&error)))?;
        let joints: Vec<&JointConfig> = arm.robot.joints.iter().collect();
        let passed = excesses(&path, &joints, arm.period_s);
        if !passed.is_empty() {
            return Err(Refusal::invalid(beyond_limits(&passed, arm)));
        }
        let brake = Brake::of(&path, &joints).ok_or_else(|| {
            Refusal::invalid(
                "the trajectory uses the limits up, so CANCEL could not stop the arm on its path: plan it a little slower",
            )
        })?;
        let duration_s = path.duration_s();
        let description = format!("Goal of FollowJointTrajectory, {duration_s:.3} s.");
        let parts = NetParts {
            name,
            description: &description,
            device: &arm.device,
            path: &path,
            brake,
        };
        Ok(GoalNet {
            text: text(&parts),
            duration_s,
            end: path.end.clone(),
        })
    }
}

fn refuse_other_parts(goal: &Goal) -> Result<(), Refusal> {
    let start = goal.trajectory.header.stamp;
    if start != Stamp::default() {
        let now = Stamp::now();
        return Err(match (start.sec, start.nanosec) < (now.sec, now.nanosec) {
            true => Refusal::new(
                code::OLD_HEADER_TIMESTAMP,
                "header.stamp is in the past: let it be 0, which starts at once",
            ),
            false => Refusal::invalid(
                "header.stamp is a start time, which a net does not have: let it be 0, which starts at once",
            ),
        });
    }
    let has_components =
        !goal.component_path_tolerance.is_empty() || !goal.component_goal_tolerance.is_empty();
    if !goal.multi_dof_trajectory.joint_names.is_empty() || has_components {
        return Err(Refusal::invalid(
            "an arm has no joints with several degrees of freedom: omit multi_dof_trajectory and component tolerances",
        ));
    }
    let fast = |one: &&JointTolerance| one.velocity > 0.0 || one.acceleration > 0.0;
    if let Some(one) = goal.path_tolerance.iter().find(fast) {
        return Err(Refusal::invalid(format!(
            "path_tolerance of `{}`: velocities and accelerations on the path are not compared; give a position",
            one.name
        )));
    }
    Ok(())
}

/// Returns for each joint of the arm its index in the goal. Names are those of `/joint_states`, or of the robot's file.
fn order(given: &[String], arm: &GoalArm) -> Result<Vec<usize>, Refusal> {
    let of_robot = arm.robot.joints.iter().map(|joint| &joint.name);
    let places = arm.joints.iter().zip(of_robot).map(|(ours, own)| {
        let place = |wanted: &String| given.iter().position(|name| name == wanted);
        place(ours).or_else(|| place(own))
    });
    let places: Option<Vec<usize>> = places.collect();
    places
        .filter(|places| places.len() == given.len() && places.len() == arm.robot.joints.len())
        .ok_or_else(|| {
            Refusal::new(
                code::INVALID_JOINTS,
                format!(
                    "the joints are {}, but those of `{}` are {}: name each of them once",
                    given.join(", "),
                    arm.device,
                    arm.joints.join(", ")
                ),
            )
        })
}

/// Returns the tolerance of the position of each joint; 0 and less are none.
fn tolerances(given: &[JointTolerance], arm: &GoalArm) -> Result<Vec<f64>, Refusal> {
    let mut found = vec![f64::INFINITY; arm.joints.len()];
    for tolerance in given {
        let of_robot = arm.robot.joints.iter().map(|joint| &joint.name);
        let mut names = arm.joints.iter().zip(of_robot);
        let place = names.position(|(ours, own)| [ours, own].contains(&&tolerance.name));
        match place.and_then(|place| found.get_mut(place)) {
            Some(slot) if tolerance.position > 0.0 => *slot = tolerance.position,
            Some(_) => {}
            None => {
                let words = format!(
                    "a tolerance is for `{}`, which `{}` has not",
                    tolerance.name, arm.device
                );
                return Err(Refusal::new(code::INVALID_JOINTS, words));
            }
        }
    }
    Ok(found)
}

fn not_a_motion(error: &PathError) -> String {
    let help = match error {
        PathError::OnePoint => "add the positions where the arm rests at 0 s",
        PathError::InMotion { .. } => "a net begins and ends at rest: let these velocities be 0",
        _ => "let the first point be where the arm rests, at 0 s",
    };
    format!("{error}: {help}")
}

fn beyond_limits(passed: &[Excess], arm: &GoalArm) -> String {
    let row =
        |excess: &Excess| excess.sentence(arm.joints.get(excess.joint).map_or("?", String::as_str));
    let rows: Vec<String> = passed.iter().map(row).collect();
    let help = match stretch(passed) {
        Some(factor) => format!("{factor:.2} times as slow it keeps them"),
        None => "plan it with the limits of /robot_description".to_owned(),
    };
    format!(
        "the trajectory passes limits of `{}`: {}; {help}",
        arm.device,
        rows.join("; ")
    )
}

#[cfg(test)]
mod tests;
