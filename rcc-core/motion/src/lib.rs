//! Jerk-limited motion: paths of an arm with time scaling and speed override, the stop trajectory of a driver whose
//! commands stopped, and the time-optimal motion of one axis. Objects are planned off the real-time thread; stepping
//! them there (or in a driver) does not allocate and cannot fail.
//!
//! Motions are phases of constant jerk in closed form, computed in the cycle that requests them. From rsruckig only the
//! solver for a single axis is used (module [`goal`]); the tests use it as a reference for everything else.
#![forbid(unsafe_code)]

mod after_until;
pub mod geometry;
pub mod goal;
mod jerk_profile;
mod motion;
mod path_clock;
mod planned_path;
mod stop_trajectory;

pub use motion::{Motion, MotionSet, MotionSetBuilder};
pub use path_clock::{
    CLOCK_WORDS, PathBounds, PathClock, PathLimitsError, PathPiece, duration_s, stop_time,
};
pub use planned_path::{PlannedSection, ReducedBlend, SlowSection, TimeScaling};
pub use stop_trajectory::{StopFault, StopLimits, StopLimitsError, StopTrajectory};
