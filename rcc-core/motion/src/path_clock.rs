//! Path clock: moves the path parameter s from rest at 0 to rest at the path length, with a speed override, pauses and
//! stops that may change in any cycle. Stepped by the real-time thread: no allocation, no failure, every loop bounded.
//!
//! The current motion is a handful of phases of constant jerk. It is replanned only when a new command arrives or the
//! clock enters a faster piece, and replaced only by a motion that is known to keep every limit up to its end. So it is
//! always safe to continue the current motion.
//!
//! The fastest stop keeps every limit that any other forward motion from the same state keeps: while it builds up and
//! holds its deceleration, no other motion is slower; while it reduces the deceleration, −a = √(2Jv), no other motion
//! may brake harder at the same velocity. A stop on the path therefore needs no look-ahead.

use rcc_core::axis::AxisState;
use rcc_core::path::{PathLimits, PathState, SpeedOverride};

use crate::jerk_profile::{AccelerationLimits, JerkProfile, VelocityChange};

mod approach;
mod motion_planner;
mod path_bounds;
mod state_words;

use motion_planner::MotionPlanner;
pub use path_bounds::{PathBounds, PathLimitsError, PathPiece};
pub use state_words::CLOCK_WORDS;

/// A speed override below this fraction counts as a pause.
const SPEED_MIN: f64 = 1e-6;

/// Most motions that may end within one cycle. Pieces last a cycle or longer, so at most two do.
const ENDS_MAX: usize = 8;

/// The command that the clock follows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum ClockCommand {
    /// No command received yet.
    #[default]
    None,
    /// Run with the velocity limits scaled by this factor, in (0, 1].
    Run(f64),
    /// Come to rest and continue later.
    Pause,
    /// Come to rest and stay there.
    Stop,
}

impl ClockCommand {
    fn of(speed_override: SpeedOverride) -> Self {
        if speed_override.stop {
            Self::Stop
        } else if speed_override.pause
            || speed_override.speed.is_nan()
            || speed_override.speed < SPEED_MIN
        {
            Self::Pause
        } else {
            Self::Run(speed_override.speed.min(1.0))
        }
    }
}

/// How the current motion ends.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum MotionEnd {
    /// At rest, at any position.
    #[default]
    Rest,
    /// At the end of a piece with zero acceleration, at a velocity from which the rest of the path can be kept.
    PieceEnd {
        /// Path parameter at the end of the piece; `velocity` is ds/dt there.
        s: f64,
        velocity: f64,
    },
    /// Passes the end of a piece while still slowing down.
    Passing,
}

/// A motion, and when it is to be replaced.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct PlannedMotion {
    profile: JerkProfile,
    end: MotionEnd,
    /// When to replan, s after its beginning: at its end, or where a faster piece begins.
    until_s: f64,
}

impl PlannedMotion {
    /// The fastest stop from `start`.
    fn stop(start: AxisState, limits: AccelerationLimits) -> Self {
        let profile = limits.stop(start).profile(start);
        Self {
            profile,
            end: MotionEnd::Rest,
            until_s: profile.duration_s(),
        }
    }
}

/// Moves a path parameter from 0 to the length of its path in jerk-limited motion, one cycle per step.
///
/// No speed override can make it fail, violate a limit, go backwards or pass the end. s is sampled from one continuous
/// motion that keeps the limits, so its finite differences keep them too.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathClock {
    command: ClockCommand,
    planned: PlannedMotion,
    /// Time from the beginning of the current motion to the cycle from which `cycle` counts, s.
    offset_s: f64,
    /// Cycles since then.
    cycle: u64,
    last: PathState,
}

impl PathClock {
    /// A clock at rest at s = 0.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A clock that takes over from a state into which something else has brought the path.
    pub(crate) fn moving(from: AxisState) -> Self {
        Self {
            command: ClockCommand::Run(1.0),
            last: PathState {
                s: from.position,
                velocity: from.velocity,
                acceleration: from.acceleration,
                ..PathState::default()
            },
            ..Self::default()
        }
    }

    /// The last state returned; at rest at 0 before the first step.
    pub(crate) fn last(&self) -> PathState {
        self.last
    }

    /// Returns true after the first step.
    pub(crate) fn has_begun(&self) -> bool {
        self.command != ClockCommand::None
    }

    /// Returns to the state after [`PathClock::new`].
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// For a path with a time law, whose speed is 0 at its start at any clock speed: a clock that has not begun starts at
    /// its permitted speed, not at 0. Does nothing if the clock has begun.
    pub fn start_rolling(&mut self, bounds: &PathBounds, speed_override: SpeedOverride) {
        if let (ClockCommand::None, ClockCommand::Run(speed)) =
            (self.command, ClockCommand::of(speed_override))
        {
            self.last.velocity = speed * bounds.least_velocity();
        }
    }

    /// Advances by one cycle and returns the state: s = 0 at rest in the first step, one cycle further in each step
    /// after it.
    ///
    /// `bounds` must be the same in every step. A `stop` cannot be taken back. A pause can be, and the speed may change
    /// at any time: it scales every velocity limit (0..1; below 10⁻⁶ or NaN: a pause). At the end s is exactly the
    /// length; after a stop it stays where the stop ended.
    pub fn step(&mut self, bounds: &PathBounds, speed_override: SpeedOverride) -> PathState {
        self.advance(bounds, speed_override, |_, _, _| ())
    }

    /// As [`PathClock::step`]; passes each segment that was executed to `made`: the profile, from when, until when (s).
    fn advance(
        &mut self,
        bounds: &PathBounds,
        speed_override: SpeedOverride,
        mut made: impl FnMut(&JerkProfile, f64, f64),
    ) -> PathState {
        let stopping = self.last.stopping || speed_override.stop;
        self.last.stopping = stopping;
        if self.last.done {
            return self.last;
        }
        let command = ClockCommand::of(SpeedOverride {
            stop: stopping,
            ..speed_override
        });
        let first = self.command == ClockCommand::None;
        if command != self.command {
            self.apply_command(bounds, command);
        }
        let mut from_s = self.elapsed_s(bounds);
        self.cycle = self.cycle.saturating_add(u64::from(!first));
        for _ in 0..ENDS_MAX {
            let (t_s, until_s) = (self.elapsed_s(bounds), self.planned.until_s);
            if t_s < until_s {
                made(&self.planned.profile, from_s, t_s);
                let (state, jerk) = self.planned.profile.sample(t_s);
                return self.report(bounds, state, jerk);
            }
            if from_s < until_s {
                made(&self.planned.profile, from_s, until_s);
            }
            if let Some(rest) = self.next_motion(bounds, t_s - until_s) {
                return rest;
            }
            from_s = self.elapsed_s(bounds) - (t_s - until_s);
        }
        let (state, jerk) = self.planned.profile.sample(self.planned.until_s);
        self.report(bounds, state, jerk)
    }

    /// Time since the current motion began, s.
    fn elapsed_s(&self, bounds: &PathBounds) -> f64 {
        #[allow(clippy::cast_precision_loss)] // 2^53 cycles are 285,000 years at 1 kHz.
        let cycles = self.cycle as f64;
        self.offset_s + cycles * bounds.dt_s()
    }

    /// Replans from the last state for a new command, unless the current motion already fulfils it.
    fn apply_command(&mut self, bounds: &PathBounds, command: ClockCommand) {
        let before = std::mem::replace(&mut self.command, command);
        let start = AxisState {
            position: self.last.s,
            velocity: self.last.velocity,
            acceleration: self.last.acceleration,
        };
        let new = match command {
            ClockCommand::Run(speed) => {
                let slower = !matches!((before, self.planned.end),
                    (ClockCommand::Run(before), MotionEnd::PieceEnd { .. }) if before <= speed);
                let planner = MotionPlanner {
                    bounds,
                    start,
                    speed,
                };
                let new = planner.fastest_motion();
                new.or_else(|| planner.slowing().filter(|_| slower))
            }
            _ if before == ClockCommand::Pause => None,
            _ => Some(PlannedMotion::stop(start, bounds.acceleration_limits())),
        };
        // Without a better motion the current one continues; before the first command that is rest at 0.
        if let Some(new) = new {
            (self.planned, self.offset_s, self.cycle) = (new, 0.0, 0);
        }
    }

    /// The current motion ended, or entered a faster piece, `over_s` (s) ago: plans the next motion, or returns the
    /// state at rest.
    fn next_motion(&mut self, bounds: &PathBounds, over_s: f64) -> Option<PathState> {
        let PlannedMotion {
            profile,
            end,
            until_s,
        } = self.planned;
        let passing = until_s < profile.duration_s();
        let state = match end {
            MotionEnd::PieceEnd { s, velocity } if !passing => AxisState {
                position: s,
                velocity,
                acceleration: 0.0,
            },
            MotionEnd::Rest => AxisState {
                position: profile.end_position(),
                ..AxisState::default()
            },
            _ => profile.sample(until_s).0,
        };
        let at_end = state.position >= bounds.length() - bounds.slack();
        let resting = end == MotionEnd::Rest || at_end;
        let speed = match self.command {
            ClockCommand::Run(speed) if !at_end => speed,
            _ if resting => return Some(self.rest(bounds, state.position, at_end)),
            // A pause continues to its rest.
            _ => return Some(self.report(bounds, state, 0.0)),
        };
        let planner = MotionPlanner {
            bounds,
            start: state,
            speed,
        };
        let new = match (planner.fastest_motion(), end) {
            (None, MotionEnd::PieceEnd { .. }) if passing => {
                // Continue the current motion to its end.
                self.planned.until_s = profile.duration_s();
                return None;
            }
            (new, _) => new.or_else(|| planner.slowing()),
        };
        self.planned =
            new.unwrap_or_else(|| PlannedMotion::stop(state, bounds.acceleration_limits()));
        (self.offset_s, self.cycle) = (over_s, 0);
        None
    }

    /// At rest at `s`.
    fn rest(&mut self, bounds: &PathBounds, s: f64, at_end: bool) -> PathState {
        let position = if at_end { bounds.length() } else { s };
        self.last.done = at_end || self.command == ClockCommand::Stop;
        let rest = AxisState {
            position,
            ..AxisState::default()
        };
        self.report(bounds, rest, 0.0)
    }

    /// Stores and returns the state; rounding must not lead backwards or beyond the end.
    fn report(&mut self, bounds: &PathBounds, state: AxisState, jerk: f64) -> PathState {
        self.last = PathState {
            s: state.position.min(bounds.length()).max(self.last.s),
            velocity: state.velocity.max(0.0),
            acceleration: state.acceleration,
            jerk,
            ..self.last
        };
        self.last
    }
}

/// Duration of a motion along a whole path at full speed, s.
#[must_use]
pub fn duration_s(bounds: &PathBounds) -> f64 {
    let mut clock = PathClock::new();
    clock.apply_command(bounds, ClockCommand::Run(1.0));
    let mut sum_s = 0.0;
    // Each piece is entered once; where a motion cannot continue, it comes to rest and starts again.
    for _ in 0..4 * bounds.pieces() + 4 {
        sum_s += clock.planned.until_s;
        if clock.next_motion(bounds, 0.0).is_some() {
            break;
        }
    }
    sum_s
}

/// Greatest velocity of a motion along a whole path of one piece.
pub(crate) fn peak(bounds: &PathBounds) -> f64 {
    let mut clock = PathClock::new();
    clock.apply_command(bounds, ClockCommand::Run(1.0));
    let corners = clock.planned.profile.corners();
    corners.map(|corner| corner.velocity).fold(0.0, f64::max)
}

/// Duration of the fastest stop from `velocity` and `acceleration` under the acceleration and jerk limits of `limits`,
/// s. A clock that is told to stop is at rest after this time, rounded up to a cycle. NaN in, NaN out.
#[must_use]
pub fn stop_time(velocity: f64, acceleration: f64, limits: &PathLimits) -> f64 {
    let limits = AccelerationLimits {
        acceleration: limits.acceleration,
        jerk: limits.jerk,
    };
    VelocityChange::new(velocity, acceleration, limits).duration_s()
}

#[cfg(test)]
mod tests;
