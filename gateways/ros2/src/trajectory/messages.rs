//! The messages of `control_msgs/FollowJointTrajectory` (Galactic and later) and of `trajectory_msgs`, field by field. Plain
//! data.

use std::time::{SystemTime, UNIX_EPOCH};

use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// `builtin_interfaces/Time` or `Duration`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds.
    pub nanosec: u32,
}

impl Stamp {
    fn of_ns(ns: u64) -> Stamp {
        Stamp {
            // ROS has 31 bits of seconds: until 2038.
            sec: i32::try_from(ns / 1_000_000_000).unwrap_or(i32::MAX),
            nanosec: (ns % 1_000_000_000) as u32,
        }
    }

    /// Returns the time since 1970.
    #[must_use]
    pub fn now() -> Stamp {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        Stamp::of_ns(now.map_or(0, |now| u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)))
    }
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// When; 0: at once.
    pub stamp: Stamp,
    /// Frame; joints have none.
    pub frame_id: String,
}

/// `trajectory_msgs/JointTrajectoryPoint`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointPoint {
    /// rad
    pub positions: Vec<f64>,
    /// rad/s
    pub velocities: Vec<f64>,
    /// rad/s²
    pub accelerations: Vec<f64>,
    /// N·m
    pub effort: Vec<f64>,
    /// Time from the start.
    pub time_from_start: Stamp,
}

/// `trajectory_msgs/JointTrajectory`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectory {
    /// Its stamp is the time of the start; 0: at once.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// The points.
    pub points: Vec<JointPoint>,
}

/// `trajectory_msgs/MultiDOFJointTrajectoryPoint`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MultiDofPoint {
    /// Translations (m) and quaternions `[x y z w]`.
    pub transforms: Vec<[f64; 7]>,
    /// m/s and rad/s
    pub velocities: Vec<[f64; 6]>,
    /// m/s² and rad/s²
    pub accelerations: Vec<[f64; 6]>,
    /// Time from the start.
    pub time_from_start: Stamp,
}

/// `trajectory_msgs/MultiDOFJointTrajectory`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MultiDofTrajectory {
    /// As of a `JointTrajectory`.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// The points.
    pub points: Vec<MultiDofPoint>,
}

/// `control_msgs/JointTolerance`: 0 is the server's default, less than 0 is none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTolerance {
    /// The joint.
    pub name: String,
    /// rad
    pub position: f64,
    /// rad/s
    pub velocity: f64,
    /// rad/s²
    pub acceleration: f64,
}

/// `control_msgs/JointComponentTolerance`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComponentTolerance {
    /// The joint.
    pub joint_name: String,
    /// Its component.
    pub component: u16,
    /// m or rad
    pub position: f64,
    /// m/s or rad/s
    pub velocity: f64,
    /// m/s² or rad/s²
    pub acceleration: f64,
}

/// The goal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// The trajectory.
    pub trajectory: JointTrajectory,
    /// Of joints with several degrees of freedom.
    pub multi_dof_trajectory: MultiDofTrajectory,
    /// While the arm moves.
    pub path_tolerance: Vec<JointTolerance>,
    /// While it moves, of joints with several degrees of freedom.
    pub component_path_tolerance: Vec<ComponentTolerance>,
    /// At the end.
    pub goal_tolerance: Vec<JointTolerance>,
    /// At the end, of joints with several degrees of freedom.
    pub component_goal_tolerance: Vec<ComponentTolerance>,
    /// Time after the end of the trajectory.
    pub goal_time_tolerance: Stamp,
}
impl Message for Goal {}

/// Codes of the result.
pub mod code {
    /// The goal was reached.
    pub const SUCCESSFUL: i32 = 0;
    /// The trajectory is refused.
    pub const INVALID_GOAL: i32 = -1;
    /// The joints are not those of the arm.
    pub const INVALID_JOINTS: i32 = -2;
    /// The start was in the past.
    pub const OLD_HEADER_TIMESTAMP: i32 = -3;
    /// The arm left the path, or was stopped on it.
    pub const PATH_TOLERANCE_VIOLATED: i32 = -4;
    /// The arm does not rest at the end of the path.
    pub const GOAL_TOLERANCE_VIOLATED: i32 = -5;
}

/// The result.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outcome {
    /// One of [`code`].
    pub error_code: i32,
    /// For people.
    pub error_string: String,
}
impl Message for Outcome {}

/// The feedback.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Feedback {
    /// When.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// Set-points.
    pub desired: JointPoint,
    /// Measured.
    pub actual: JointPoint,
    /// Set-points minus measured positions.
    pub error: JointPoint,
    /// Empty.
    pub multi_dof_joint_names: Vec<String>,
    /// Empty.
    pub multi_dof_desired: MultiDofPoint,
    /// Empty.
    pub multi_dof_actual: MultiDofPoint,
    /// Empty.
    pub multi_dof_error: MultiDofPoint,
}
impl Message for Feedback {}
