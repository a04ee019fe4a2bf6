//! Jerk-limited motion in one dimension: the clock of a path, and the way to rest when nobody commands any more.
//! Objects are planned off the real-time thread; stepping them there (or in a driver) allocates nothing and cannot fail.
//!
//! rsruckig plans the way from rest to rest, where an error may still be answered with words: its error paths allocate,
//! and it recalculates on a NaN. What remains for the cycle is to evaluate a handful of phases of constant jerk, and the
//! stop, which has a closed form.
#![forbid(unsafe_code)]

pub mod geometry;
pub mod goal;
mod line;
mod motion;
mod path_clock;
mod profile;
mod rest;

pub use motion::{Builder, Motion, MotionSet};
pub use path_clock::{CLOCK_WORDS, PathClock, PathLimitsError, stop_time};
pub use rest::{Rest, RestFault, RestLimits, RestLimitsError};
