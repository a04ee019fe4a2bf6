//! Jerk-limited motion in one dimension: the clock of a path, and the way to rest when nobody commands any more.
//! Objects are planned off the real-time thread; stepping them there (or in a driver) allocates nothing and cannot fail.
//!
//! Motions are phases of constant jerk in closed form, made in the cycle that asks for them. Of rsruckig the goals of
//! single axes take the mathematics; everything else it only judges in the tests.
#![forbid(unsafe_code)]

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
pub use planned_path::ReducedBlend;
pub use stop_trajectory::{StopFault, StopLimits, StopLimitsError, StopTrajectory};
