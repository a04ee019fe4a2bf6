//! One-dimensional motion along a path: what a motion primitive asks of a path clock, and what it gets each cycle.
//! Plain data and one trait; used by the real-time thread, implemented outside this package where objects need a heap.

use serde::{Deserialize, Serialize};

/// How far and how fast the path parameter s may go, from rest at 0 to rest at `length`.
///
/// s is metres for a straight line, radians for a rotation, or any other unit as long as all four agree.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PathLimits {
    /// Length of the path (≥ 0; 0 is a path that is done at once).
    pub length: f64,
    /// Largest ds/dt (> 0), per second.
    pub velocity: f64,
    /// Largest |d²s/dt²| (> 0), per second squared.
    pub acceleration: f64,
    /// Largest |d³s/dt³| (> 0), per second cubed.
    pub jerk: f64,
}

/// Where a path clock is in this cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathState {
    /// Path parameter, in [0, length]; exactly `length` at the end, never smaller than in the cycle before.
    pub s: f64,
    /// ds/dt, in [0, velocity limit].
    pub velocity: f64,
    /// d²s/dt², within the acceleration limit.
    pub acceleration: f64,
    /// At rest for good: at the end of the path, or where a stop ended.
    pub done: bool,
    /// A stop was asked for in this cycle or an earlier one.
    pub stopping: bool,
}

/// The path clocks of one running net, by index.
pub trait PathClocks {
    /// Steps clock `index` by one cycle and returns its state; the first step returns the state at time 0 (s = 0, rest).
    ///
    /// Once `stop` was true the clock brakes to rest on the path, within its limits, and stays there. `None`: there is
    /// no such clock.
    fn step(&mut self, index: usize, stop: bool) -> Option<PathState>;
}

impl PathClocks for () {
    /// A net without motions has no clocks.
    fn step(&mut self, _index: usize, _stop: bool) -> Option<PathState> {
        None
    }
}
