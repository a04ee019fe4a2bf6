//! Motion along a path: what a primitive asks for when its net is made ready, and what it gets in each cycle.
//! Plain data and two traits; what needs a heap to be built is implemented outside of this package (rcc-motion).

use serde::{Deserialize, Serialize};

mod fault;
pub mod leg_row;
mod legs;

pub use fault::{MotionFault, Quantity};
pub use legs::{
    ArcOrientation, ElbowMotion, LEGS_MAX, Leg, MotionLimits, PathRequest, PathSegment, RelativeTo,
    SpeedProfile,
};

use crate::axis::{AxisState, Phases, stop_and_go};
use crate::frame::PrepareFault;
use crate::message::Joints;
use crate::pose::Pose;

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
    /// d³s/dt³, within the jerk limit, with which the motion goes on; 0 at rest.
    pub jerk: f64,
    /// At rest for good: at the end of the path, or where a stop ended.
    pub done: bool,
    /// A stop was asked for in this cycle or an earlier one.
    pub stopping: bool,
}

/// What a net says to a motion in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedOverride {
    /// Come to rest on the path, for good.
    pub stop: bool,
    /// Come to rest on the path while this is true, and go on afterwards.
    pub pause: bool,
    /// Part of every velocity limit that may be used, 0..1; more is 1; below 10⁻⁶, or NaN, is a pause.
    pub speed: f64,
}

impl SpeedOverride {
    /// Go on, with all that the limits allow.
    pub const RUN: SpeedOverride = SpeedOverride {
        stop: false,
        pause: false,
        speed: 1.0,
    };

    /// Come to rest for good.
    pub const STOP: SpeedOverride = SpeedOverride {
        stop: true,
        ..SpeedOverride::RUN
    };
}

/// Where a motion is in this cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionState {
    /// Along the whole path, in the path's own unit.
    pub path: PathState,
    /// The leg that the motion is in, from 0; a blend belongs to the leg that it leaves.
    pub leg: u32,
    /// Set-point of the flange, in the arm's base.
    pub pose: Pose,
    /// Set-point of the joints, rad.
    pub joints: Joints,
    /// Part of the whole path that is behind it, 0 to 1; never falls.
    pub progress: f64,
    /// Way of the flange since the start, m.
    pub distance: f64,
    /// Speed of the flange along the path, m/s.
    pub speed: f64,
    /// Acceleration of the flange along the path, m/s².
    pub acceleration: f64,
}

/// The motions of one running net, by index. The real-time thread.
pub trait Motions {
    /// Steps motion `index` by one cycle; the first step gives its start, at rest.
    ///
    /// It never leaves its path, goes forward only, and keeps its limits whatever the drives are. `None`: there is no
    /// such motion.
    fn step(&mut self, index: usize, drive: SpeedOverride) -> Option<MotionState>;

    /// The way of one axis from any state to rest at `goal`, as fast as `limits` allow; it keeps nothing.
    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases;
}

impl Motions for () {
    /// A net without motions.
    fn step(&mut self, _index: usize, _drive: SpeedOverride) -> Option<MotionState> {
        None
    }

    /// Without a planner: to rest first, and on from there.
    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
        stop_and_go(from, goal, limits)
    }
}

/// Builds the motions of a net that is made ready; off the real-time thread.
pub trait MotionBuilder {
    /// Builds motion `index`.
    ///
    /// # Errors
    /// What cannot be gone along as asked for.
    fn path(&mut self, index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault>;
}
