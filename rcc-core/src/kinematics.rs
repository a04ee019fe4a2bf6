//! Kinematics of the supported arm types: forward, Jacobian and inverse. The inverse is in closed form, or numeric with a
//! bounded number of steps. Pure functions of their arguments; used by the loader and by the real-time thread.

mod arm;
mod arm_angles;
mod axes;
mod branch;
mod links;
mod ortho;
mod serial;
mod singularity;
mod srs;
mod turns;
mod velocity;

pub use arm::{Arm, InverseKinematicsError, PARAMETERS};
pub use arm_angles::ArmAngles;
pub use axes::AXES_MAX;
pub use branch::{ArmConfiguration, BRANCHES, Branch, Unreachable};
pub use links::LinkPoints;
pub use ortho::OrthoParallelArm;
pub use serial::{JointAxis, NumericSolution, RESIDUAL_MAX, STEPS_MAX, SerialArm};
pub use singularity::{Singularity, SingularityKind};
pub use srs::SrsArm;
pub use turns::{OutOfLimits, nearest_turns, turns_by_signs, turns_within, within_limits};

use crate::joints::JOINTS_MAX;

/// A geometric Jacobian: rows vx vy vz (m/s) wx wy wz (rad/s) of the flange origin, in base axes, per rad/s of each joint;
/// columns beyond the arm's joints are 0.
pub type ArmJacobian = [[f64; JOINTS_MAX]; 6];
