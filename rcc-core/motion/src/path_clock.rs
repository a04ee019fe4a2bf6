//! The clock of a path: how the path parameter s goes from rest at 0 to rest at the length, or stops on the way.
//! Planned by the executor's intake thread (rsruckig, which allocates), stepped by the real-time thread (which must not).

use rcc_core::path::{PathLimits, PathState};
use rsruckig::prelude::{DataArrayOrVec, InputParameter, Ruckig, ThrowErrorHandler, Trajectory};
use thiserror::Error;

use crate::profile::{PHASES_MAX, Profile, State, Stop};

mod words;

pub use words::CLOCK_WORDS;

/// Where a²/j is more than this many times v, the planner fails now and then (measured: one in 10⁴ of random states, all
/// of them there), and no real machine has such limits: its acceleration could never be reached.
const SHAPE_MAX: f64 = 1000.0;

/// A plan may miss its length or a limit by this much, relative to it.
const PLAN_TOLERANCE: f64 = 1e-12;

/// Why limits cannot be planned with.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PathLimitsError {
    /// The length is negative, NaN or infinite.
    #[error("path length {length}: give a finite number, 0 or more")]
    Length {
        /// What was given.
        length: f64,
    },
    /// A limit is zero, negative, NaN or infinite.
    #[error("path {limit} limit {value}: give a finite number greater than 0")]
    Limit {
        /// `velocity`, `acceleration` or `jerk`.
        limit: &'static str,
        /// What was given.
        value: f64,
    },
    /// The cycle time is zero, negative, NaN or infinite.
    #[error("cycle time {dt_s} s: give a finite number greater than 0")]
    CycleTime {
        /// What was given, s.
        dt_s: f64,
    },
    /// a²/j is more than 1000 times v.
    #[error(
        "path limits: acceleration²/jerk is {ratio:.0} times the velocity, 1000 at most; raise the jerk limit"
    )]
    Shape {
        /// acceleration² / (jerk × velocity).
        ratio: f64,
    },
    /// The planner found no motion, or one that breaks a limit: lengths and limits are too many orders apart.
    #[error(
        "path of length {length} cannot be planned with these limits: they are too many orders of magnitude apart"
    )]
    Unplannable {
        /// The length that was given.
        length: f64,
    },
}

/// Moves a path parameter from 0 to the length in jerk-limited, time-optimal motion, one cycle a step.
///
/// A step has no input but `stop`, so it cannot fail. s is sampled from one continuous motion that keeps the limits, so
/// its finite differences keep them too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathClock {
    limits: PathLimits,
    dt_s: f64,
    plan: Profile,
    /// The motion being made: the plan or the stop.
    active: Profile,
    /// Cycles since the active motion began, of the next step.
    cycle: u64,
    last: PathState,
}

impl PathClock {
    /// A clock at rest at s = 0 that advances `dt_s` (s) a step.
    ///
    /// # Errors
    /// A limit that is not a finite number greater than 0 (the length may be 0), acceleration²/jerk beyond 1000 times
    /// the velocity, or limits that the planner cannot unite.
    pub fn new(limits: PathLimits, dt_s: f64) -> Result<Self, PathLimitsError> {
        check(&limits, dt_s)?;
        let plan = plan(&limits)?;
        Ok(Self {
            limits,
            dt_s,
            plan,
            active: plan,
            cycle: 0,
            last: PathState::default(),
        })
    }

    /// Back to the state after [`PathClock::new`]; allocates nothing.
    pub fn reset(&mut self) {
        (self.active, self.cycle, self.last) = (self.plan, 0, PathState::default());
    }

    /// How long the whole path takes without a stop, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.plan.duration_s()
    }

    /// The state of this cycle: s = 0 in the first step, `dt_s` further in each one after it.
    ///
    /// The first `stop` replaces the plan by the fastest stop from the state of the step before; it cannot be taken
    /// back. At the end s is exactly the length; after a stop it stays where the stop ended.
    pub fn step(&mut self, stop: bool) -> PathState {
        let stopping = self.last.stopping || stop;
        if stopping && !self.last.stopping {
            let PathState {
                s: position,
                velocity,
                acceleration,
                ..
            } = self.last;
            let start = State {
                position,
                velocity,
                acceleration,
            };
            let PathLimits {
                acceleration: a,
                jerk,
                ..
            } = self.limits;
            self.active = Stop::new(velocity, acceleration, a, jerk).profile(start);
            self.cycle = 1;
        }
        #[allow(clippy::cast_precision_loss)] // 2^53 cycles are 285,000 years at 1 kHz.
        let t_s = self.cycle as f64 * self.dt_s;
        self.cycle = self.cycle.saturating_add(1);
        let end = if stopping {
            self.active.end_position()
        } else {
            self.limits.length
        };
        let rest = State {
            position: end,
            ..State::default()
        };
        let (state, done) = self
            .active
            .at(t_s)
            .map_or((rest, true), |state| (state, false));
        // Rounding may neither lead backwards nor beyond the end.
        self.last = PathState {
            s: state.position.min(self.limits.length).max(self.last.s),
            velocity: state.velocity.max(0.0),
            acceleration: state.acceleration,
            done,
            stopping,
        };
        self.last
    }
}

/// How long the fastest stop from `velocity` and `acceleration` takes under the acceleration and jerk of `limits`, s.
/// A clock that is told to stop is at rest after this time, rounded up to a cycle. NaN in, NaN out.
#[must_use]
pub fn stop_time(velocity: f64, acceleration: f64, limits: &PathLimits) -> f64 {
    Stop::new(velocity, acceleration, limits.acceleration, limits.jerk).duration_s()
}

fn check(limits: &PathLimits, dt_s: f64) -> Result<(), PathLimitsError> {
    let PathLimits {
        length,
        velocity,
        acceleration,
        jerk,
    } = *limits;
    if !(length.is_finite() && length >= 0.0) {
        return Err(PathLimitsError::Length { length });
    }
    for (limit, value) in [
        ("velocity", velocity),
        ("acceleration", acceleration),
        ("jerk", jerk),
    ] {
        if !(value.is_finite() && value > 0.0) {
            return Err(PathLimitsError::Limit { limit, value });
        }
    }
    if !(dt_s.is_finite() && dt_s > 0.0) {
        return Err(PathLimitsError::CycleTime { dt_s });
    }
    let ratio = acceleration / jerk * (acceleration / velocity);
    if ratio <= SHAPE_MAX {
        Ok(())
    } else {
        Err(PathLimitsError::Shape { ratio })
    }
}

/// Plans from rest at 0 to rest at the length.
///
/// The planner's tolerances are absolute, so it is asked in units in which length and jerk are 1. In them no motion
/// reaches a velocity of 0.63 or an acceleration of 0.8, so larger limits are none.
fn plan(limits: &PathLimits) -> Result<Profile, PathLimitsError> {
    let PathLimits {
        length,
        velocity,
        acceleration,
        jerk,
    } = *limits;
    if length == 0.0 {
        return Ok(Profile::default());
    }
    let unplannable = PathLimitsError::Unplannable { length };
    let unit_s = libm::cbrt(length / jerk);
    let mut input = InputParameter::<1>::new(None);
    input.target_position[0] = 1.0;
    input.max_velocity[0] = (velocity * unit_s / length).min(1.0);
    input.max_acceleration[0] = (acceleration * unit_s / length * unit_s).min(1.0);
    input.max_jerk[0] = 1.0;
    input.min_velocity = Some(DataArrayOrVec::Stack([0.0]));
    let mut trajectory = Trajectory::<1>::new(None);
    let mut planner = Ruckig::<1, ThrowErrorHandler>::new(None, 1.0);
    planner
        .calculate(&input, &mut trajectory)
        .map_err(|_| unplannable)?;

    let found = trajectory
        .get_profiles()
        .first()
        .and_then(|section| section.first())
        .ok_or(unplannable)?;
    let mut steps = [(0.0, 0.0); PHASES_MAX];
    for ((step, t), j) in steps.iter_mut().zip(found.t).zip(found.j) {
        *step = (t * unit_s, j * jerk);
    }
    let plan = Profile::new(State::default(), steps);
    let sound = found.t.iter().all(|t| *t >= 0.0)
        && found.j.iter().all(|j| j.abs() <= 1.0 + PLAN_TOLERANCE);
    if sound && keeps(&plan, limits) {
        Ok(plan)
    } else {
        Err(unplannable)
    }
}

/// Whether a plan ends at the length and keeps the limits.
fn keeps(plan: &Profile, limits: &PathLimits) -> bool {
    let within = |value: f64, limit: f64| value <= limit * (1.0 + PLAN_TOLERANCE);
    (plan.end_position() - limits.length).abs() <= PLAN_TOLERANCE * limits.length
        && plan.corners().all(|corner| {
            within(corner.velocity, limits.velocity)
                && within(corner.acceleration.abs(), limits.acceleration)
        })
}

#[cfg(test)]
mod tests;
