//! Kinematics of the supported arm types: forward, Jacobian and inverse. The inverse is in closed form, or numeric with a
//! bounded number of steps. Pure functions of their arguments; used by the loader and by the real-time thread.

mod arm;
mod arm_angles;
mod axes;
mod branch;
mod links;
mod ortho;
mod serial;
mod srs;
mod turns;
mod velocity;

pub use arm::{Arm, ArmJacobian, InverseKinematicsError, PARAMETERS, Singularity, SingularityKind};
pub use arm_angles::ArmAngles;
pub use branch::{ArmConfiguration, BRANCHES, Branch, Unreachable};
pub use links::LinkPoints;
pub use ortho::OrthoParallelArm;
pub use serial::{AXES_MAX, JointAxis, NumericSolution, RESIDUAL_MAX, STEPS_MAX, SerialArm};
pub use srs::SrsArm;
pub use turns::{OutOfLimits, nearest_turns, turns_by_signs, turns_within, within_limits};
