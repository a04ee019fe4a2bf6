//! Motion along a path: the request that a primitive makes when its net is prepared, and the state that it gets in each
//! cycle. Plain data and two traits; implementations that need a heap are in another package (rcc-motion).

use serde::{Deserialize, Serialize};

mod fault;
pub mod leg_row;
mod legs;

pub use crate::axis::MotionLimits;
pub use fault::{AfterUntilFault, MotionFault, PrepareFault, Quantity};
pub use legs::{
    ArcOrientation, ElbowMotion, LEGS_MAX, Leg, LegConditions, LegSignals, PathRequest,
    PathSegment, RelativeTo, SpeedProfile, StopReserve,
};

use crate::axis::{AxisState, AxisTask, Phases, plan_together, stop_and_go};
use crate::joints::Joints;
use crate::pose::Pose;

/// Limits of the path parameter s, which moves from rest at 0 to rest at `length`.
///
/// The unit of s is the metre for a straight line, the radian for a rotation, or any other unit, as long as all four
/// values use it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PathLimits {
    /// Length of the path (≥ 0; a path of length 0 is done at once).
    pub length: f64,
    /// Largest ds/dt (> 0), per second.
    pub velocity: f64,
    /// Largest |d²s/dt²| (> 0), per second squared.
    pub acceleration: f64,
    /// Largest |d³s/dt³| (> 0), per second cubed.
    pub jerk: f64,
}

/// The state of a path clock in this cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathState {
    /// Path parameter, in [0, length]; exactly `length` at the end, never decreasing.
    pub s: f64,
    /// ds/dt, in [0, velocity limit].
    pub velocity: f64,
    /// d²s/dt², within the acceleration limit.
    pub acceleration: f64,
    /// d³s/dt³ of the motion from here on, within the jerk limit; 0 at rest.
    pub jerk: f64,
    /// Permanently at rest: at the end of the path, or where a stop ended.
    pub done: bool,
    /// A stop was requested in this cycle or an earlier one.
    pub stopping: bool,
}

/// The inputs of a motion in one cycle: stop, pause and speed override.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedOverride {
    /// Comes to rest on the path, permanently.
    pub stop: bool,
    /// Comes to rest on the path while true, and continues afterwards.
    pub pause: bool,
    /// Fraction of every velocity limit that may be used, 0..1; values above 1 count as 1, values below 10⁻⁶ or NaN as
    /// a pause.
    pub speed: f64,
}

impl SpeedOverride {
    /// Full speed: everything that the limits allow.
    pub const RUN: SpeedOverride = SpeedOverride {
        stop: false,
        pause: false,
        speed: 1.0,
    };

    /// Comes to rest until it may continue.
    pub const PAUSE: SpeedOverride = SpeedOverride {
        pause: true,
        ..SpeedOverride::RUN
    };

    /// Comes to rest permanently.
    pub const STOP: SpeedOverride = SpeedOverride {
        stop: true,
        ..SpeedOverride::RUN
    };
}

/// The state of a motion in this cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionState {
    /// State of the path clock along the whole path, in the path's own unit.
    pub path: PathState,
    /// Index of the current leg, from 0; a blend belongs to the leg that it leaves.
    pub leg: u32,
    /// Set-point of the flange, in the arm's base.
    pub pose: Pose,
    /// Set-point of the joints, rad.
    pub joints: Joints,
    /// Completed part of the whole path, 0 to 1; never decreases.
    pub progress: f64,
    /// Distance travelled by the flange since the start, m.
    pub distance: f64,
    /// Speed of the flange along the path, m/s.
    pub speed: f64,
    /// Acceleration of the flange along the path, m/s².
    pub acceleration: f64,
    /// At rest: the next leg waits for its condition.
    pub waiting: bool,
    /// The last leg with `until` that is over was ended by its condition; false before one is over.
    pub until_met: bool,
}

/// The motions of one running net, by index. Used by the real-time thread.
pub trait Motions {
    /// Steps motion `index` by one cycle; the first step returns its start, at rest.
    ///
    /// The motion never leaves its path, never moves backwards, and keeps its limits for any sequence of inputs.
    /// `None`: the motion does not exist.
    fn step(&mut self, index: usize, speed_override: SpeedOverride) -> Option<MotionState>;

    /// Returns the conditions that apply to motion `index` in this cycle, before its step.
    fn leg_conditions(&self, _index: usize) -> LegConditions {
        LegConditions::default()
    }

    /// As [`Motions::step`], with the conditions of [`Motions::leg_conditions`] evaluated.
    fn step_leg(
        &mut self,
        index: usize,
        speed_override: SpeedOverride,
        _signals: LegSignals,
    ) -> Option<MotionState> {
        self.step(index, speed_override)
    }

    /// Plans the motion of one axis from any state to rest at `goal`, as fast as `limits` allow; stores nothing.
    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases;

    /// Plans the motions of several axes that end at the same time; see [`plan_together`]. Stores nothing.
    fn plan_axes(&mut self, tasks: &[AxisTask], ways: &mut [Phases]);
}

impl Motions for () {
    /// There are no motions.
    fn step(&mut self, _index: usize, _speed_override: SpeedOverride) -> Option<MotionState> {
        None
    }

    /// Without a planner: stops first, and moves to the goal from there.
    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
        stop_and_go(from, goal, limits)
    }

    /// Without a planner: as above.
    fn plan_axes(&mut self, tasks: &[AxisTask], ways: &mut [Phases]) {
        let soonest = |task: &AxisTask| stop_and_go(&task.from, task.goal, &task.limits);
        plan_together(tasks, ways, soonest, |_, _| None);
    }
}

/// Builds the motions of a net that is being prepared; off the real-time thread.
pub trait MotionBuilder {
    /// Builds motion `index`.
    ///
    /// # Errors
    /// Returns the leg that cannot be travelled as requested, with the reason.
    fn path(&mut self, index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault>;
}
