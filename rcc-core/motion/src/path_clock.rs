//! The clock of a path: how the path parameter s goes from rest at 0 to rest at the length, under a speed that may change,
//! pauses and stops in any cycle. Stepped by the real-time thread: no allocation, no failure, no loop without a bound.
//!
//! The motion being made is a handful of phases of constant jerk. A new one is made only when the clock is told something
//! new or enters a faster piece, and only one that is known to keep every limit up to its end takes the place of the one
//! before: what is being done is always safe to go on with.
//!
//! The fastest stop keeps every limit that any other motion from the same state keeps that never goes backwards: where it
//! builds up and holds its deceleration no other motion is slower, and where it lets it go, −a = √(2Jv), no other may
//! brake harder at the same velocity. So whatever is being done, a stop on the way needs no look-ahead.

use rcc_core::path::{PathLimits, PathState, SpeedOverride};

use crate::jerk_profile::{
    AccelerationLimits, JerkProfile, KinematicState, VelocityChange, coasting_velocity,
};

mod approach;
mod path_bounds;
mod state_words;

use approach::{Approach, ApproachTarget, approach};
pub use path_bounds::{PathBounds, PathLimitsError, PathPiece};
pub use state_words::CLOCK_WORDS;

/// A speed below this part of the limits is none.
const SPEED_MIN: f64 = 1e-6;

/// Velocities that differ by less than this part are the same.
const SAME: f64 = 1e-10;

/// Most ends of motions in one cycle. Pieces last a cycle or longer, so two are met.
const ENDS_MAX: usize = 8;

/// What a clock was told.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum ClockCommand {
    /// Nothing yet.
    #[default]
    None,
    /// Go on with this part of the velocity limits.
    Run(f64),
    /// Come to rest, and go on later.
    Pause,
    /// Come to rest for good.
    Stop,
}

impl ClockCommand {
    fn of(drive: SpeedOverride) -> Self {
        if drive.stop {
            Self::Stop
        } else if drive.pause || drive.speed.is_nan() || drive.speed < SPEED_MIN {
            Self::Pause
        } else {
            Self::Run(drive.speed.min(1.0))
        }
    }
}

/// How the motion being made ends.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum MotionEnd {
    /// At rest, wherever that is.
    #[default]
    Rest,
    /// At the end of a piece, without acceleration, at a velocity from which the rest of the path can be kept.
    PieceEnd {
        /// Place and velocity.
        s: f64,
        velocity: f64,
    },
    /// At the end of a piece that it passes while it slows down.
    Passing,
}

/// A motion, and when it is to be replaced.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct PlannedMotion {
    profile: JerkProfile,
    end: MotionEnd,
    /// When something new is made, s from its beginning: at its end, or where a faster piece begins.
    until_s: f64,
}

impl PlannedMotion {
    /// The fastest stop.
    fn stop(start: KinematicState, limits: AccelerationLimits) -> Self {
        let profile =
            VelocityChange::new(start.velocity, start.acceleration, limits).profile(start);
        Self {
            profile,
            end: MotionEnd::Rest,
            until_s: profile.duration_s(),
        }
    }
}

/// Moves a path parameter from 0 to the length of its path in jerk-limited motion, one cycle a step.
///
/// What it is told cannot make it fail, leave the limits, go backwards or beyond the end. s is sampled from one
/// continuous motion that keeps the limits, so its finite differences keep them too.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathClock {
    command: ClockCommand,
    planned: PlannedMotion,
    /// When the motion being made began, s before the cycle from which `cycle` counts.
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

    /// A clock that goes on from a state into which something else has brought the path.
    pub(crate) fn moving(from: KinematicState) -> Self {
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

    /// What it told last; at rest at 0 before.
    pub(crate) fn last(&self) -> PathState {
        self.last
    }

    /// Back to the state after [`PathClock::new`].
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// For a path that rests at its beginning whatever its clock does: a clock that has not begun does so at the speed that
    /// it may have, instead of speeding up from none. Nothing if it has begun.
    pub fn start_rolling(&mut self, bounds: &PathBounds, drive: SpeedOverride) {
        if let (ClockCommand::None, ClockCommand::Run(speed)) =
            (self.command, ClockCommand::of(drive))
        {
            self.last.velocity = speed * bounds.least_velocity();
        }
    }

    /// The state of this cycle: s = 0 at rest in the first step, one cycle further in each one after it.
    ///
    /// `bounds` are the same in every step. A `stop` cannot be taken back; a pause can, and so can any speed: it scales
    /// every velocity limit (0..1, below 10⁻⁶ or NaN: a pause). At the end s is exactly the length; after a stop it
    /// stays where the stop ended.
    pub fn step(&mut self, bounds: &PathBounds, drive: SpeedOverride) -> PathState {
        self.advance(bounds, drive, |_, _, _| ())
    }

    /// [`PathClock::step`], which tells every part of a motion that was made: the motion, from when, until when (s).
    fn advance(
        &mut self,
        bounds: &PathBounds,
        drive: SpeedOverride,
        mut made: impl FnMut(&JerkProfile, f64, f64),
    ) -> PathState {
        let stopping = self.last.stopping || drive.stop;
        self.last.stopping = stopping;
        if self.last.done {
            return self.last;
        }
        let command = ClockCommand::of(SpeedOverride {
            stop: stopping,
            ..drive
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

    /// Time since the motion being made began, s.
    fn elapsed_s(&self, bounds: &PathBounds) -> f64 {
        #[allow(clippy::cast_precision_loss)] // 2^53 cycles are 285,000 years at 1 kHz.
        let cycles = self.cycle as f64;
        self.offset_s + cycles * bounds.dt_s()
    }

    /// Makes what is demanded from the last state on, if it was not what is being made already.
    fn apply_command(&mut self, bounds: &PathBounds, command: ClockCommand) {
        let before = std::mem::replace(&mut self.command, command);
        let start = KinematicState {
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
        // Without a better one the motion being made goes on; at the beginning that is a rest at 0.
        if let Some(new) = new {
            (self.planned, self.offset_s, self.cycle) = (new, 0.0, 0);
        }
    }

    /// The motion being made is over, or enters a faster piece, since `over_s`: makes the next one, or tells the rest.
    fn next_motion(&mut self, bounds: &PathBounds, over_s: f64) -> Option<PathState> {
        let PlannedMotion {
            profile,
            end,
            until_s,
        } = self.planned;
        let passing = until_s < profile.duration_s();
        let state = match end {
            MotionEnd::PieceEnd { s, velocity } if !passing => KinematicState {
                position: s,
                velocity,
                acceleration: 0.0,
            },
            MotionEnd::Rest => KinematicState {
                position: profile.end_position(),
                ..KinematicState::default()
            },
            _ => profile.sample(until_s).0,
        };
        let at_end = state.position >= bounds.length() - bounds.slack();
        let resting = end == MotionEnd::Rest || at_end;
        let speed = match self.command {
            ClockCommand::Run(speed) if !at_end => speed,
            _ if resting => return Some(self.rest(bounds, state.position, at_end)),
            // A pause is a way to rest.
            _ => return Some(self.report(bounds, state, 0.0)),
        };
        let planner = MotionPlanner {
            bounds,
            start: state,
            speed,
        };
        let new = match (planner.fastest_motion(), end) {
            (None, MotionEnd::PieceEnd { .. }) if passing => {
                // What is being made goes on to the end.
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
        let rest = KinematicState {
            position,
            ..KinematicState::default()
        };
        self.report(bounds, rest, 0.0)
    }

    /// Rounding may neither lead backwards nor beyond the end.
    fn report(&mut self, bounds: &PathBounds, state: KinematicState, jerk: f64) -> PathState {
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

/// How long a motion along a whole path takes at full speed, s.
#[must_use]
pub fn duration_s(bounds: &PathBounds) -> f64 {
    let mut clock = PathClock::new();
    clock.apply_command(bounds, ClockCommand::Run(1.0));
    let mut sum_s = 0.0;
    // Each piece is entered once; what cannot be gone on with comes to rest and starts again.
    for _ in 0..4 * bounds.pieces() + 4 {
        sum_s += clock.planned.until_s;
        if clock.next_motion(bounds, 0.0).is_some() {
            break;
        }
    }
    sum_s
}

/// The greatest velocity of a motion along a whole path of one piece.
pub(crate) fn peak(bounds: &PathBounds) -> f64 {
    let mut clock = PathClock::new();
    clock.apply_command(bounds, ClockCommand::Run(1.0));
    let corners = clock.planned.profile.corners();
    corners.map(|corner| corner.velocity).fold(0.0, f64::max)
}

/// Most cycles for which a rolling clock is watched: a quarter of an hour at 1 kHz.
const ROLLING_MAX: usize = 1_000_000;

/// How long it takes a clock that rolls ([`PathClock::start_rolling`]) to pass `end` at full speed, s; infinite if it does not, or
/// not within [`ROLLING_MAX`] cycles: a path that crawls past a singular position may take days.
pub(crate) fn rolling_duration_s(bounds: &PathBounds, end: f64) -> f64 {
    let mut clock = PathClock::new();
    clock.start_rolling(bounds, SpeedOverride::RUN);
    let mut time_s = 0.0;
    for _ in 0..ROLLING_MAX {
        if clock.step(bounds, SpeedOverride::RUN).s >= end {
            return time_s;
        }
        time_s += bounds.dt_s();
        if clock.last.done {
            break;
        }
    }
    f64::INFINITY
}

/// How long the fastest stop from `velocity` and `acceleration` takes under the acceleration and jerk of `limits`, s.
/// A clock that is told to stop is at rest after this time, rounded up to a cycle. NaN in, NaN out.
#[must_use]
pub fn stop_time(velocity: f64, acceleration: f64, limits: &PathLimits) -> f64 {
    let acceleration_limits = AccelerationLimits {
        acceleration: limits.acceleration,
        jerk: limits.jerk,
    };
    VelocityChange::new(velocity, acceleration, acceleration_limits).duration_s()
}

/// The ways on from a state at a speed.
#[derive(Debug, Clone, Copy)]
struct MotionPlanner<'a> {
    bounds: &'a PathBounds,
    start: KinematicState,
    speed: f64,
}

impl MotionPlanner<'_> {
    /// The fastest motion known to keep every limit up to where it ends, and from there on.
    fn fastest_motion(&self) -> Option<PlannedMotion> {
        let here = self.bounds.piece_at(self.start.position);
        let piece = self.bounds.piece(here)?;
        let cruise = self.speed * piece.velocity;
        let too_fast = match self.to_piece_end(piece.braking_piece, cruise)? {
            Ok(planned) => return Some(planned),
            Err(too_fast) => too_fast,
        };
        if let Some(Ok(planned)) = self.to_piece_end(too_fast, cruise) {
            return Some(planned);
        }
        let caps = (here..piece.braking_piece).filter_map(|index| self.bounds.piece(index));
        let least = caps.fold(piece.velocity, |least, piece| least.min(piece.cap));
        self.to_piece_end(piece.braking_piece, self.speed * least)?
            .ok()
    }

    /// To the velocity at the end of piece `braking_piece`, cruising with `cruise`; or the piece whose end would be passed
    /// too fast.
    fn to_piece_end(
        &self,
        braking_piece: usize,
        cruise: f64,
    ) -> Option<Result<PlannedMotion, usize>> {
        let piece = self.bounds.piece(braking_piece)?;
        let target = ApproachTarget {
            distance: (piece.end_s - self.start.position).max(0.0),
            cruise,
            exit: self.speed * piece.exit,
            slack: self.bounds.slack(),
        };
        let found = approach(self.start, &target, self.bounds.acceleration_limits())?;
        let profile = found.profile(self.start);
        let planned = |until_s| PlannedMotion {
            profile,
            end: MotionEnd::PieceEnd {
                s: piece.end_s,
                velocity: found.exit,
            },
            until_s,
        };
        Some(match self.faster(&found, &profile, braking_piece, cruise) {
            Ok(faster_s) => Ok(planned(faster_s.unwrap_or(profile.duration_s()))),
            Err(too_fast) => Err(too_fast),
        })
    }

    /// When the motion to `braking_piece` enters a piece that allows more than it was made for; or the piece whose end it
    /// passes faster than that or the next one allows.
    fn faster(
        &self,
        found: &Approach,
        profile: &JerkProfile,
        braking_piece: usize,
        cruise: f64,
    ) -> Result<Option<f64>, usize> {
        let KinematicState {
            velocity,
            acceleration,
            ..
        } = self.start;
        let coasting_velocity = coasting_velocity(velocity, acceleration, self.bounds.jerk());
        let fastest = velocity.max(coasting_velocity).max(found.between);
        // Who begins too fast for the speed keeps the limits themselves.
        let scale = if velocity.max(coasting_velocity) > cruise {
            1.0
        } else {
            self.speed
        };
        let braking_from_s = found.braking_from_s();
        let limited = found.between >= cruise * (1.0 - SAME);
        let mut faster_s = None;
        for index in self.bounds.piece_at(self.start.position)..braking_piece {
            let (Some(piece), Some(next)) =
                (self.bounds.piece(index), self.bounds.piece(index + 1))
            else {
                continue;
            };
            let gains = faster_s.is_none()
                && limited
                && self.speed * next.velocity > found.between * (1.0 + SAME);
            let exceeds = |velocity: f64, limit: f64| velocity > scale * limit * (1.0 + SAME);
            let doubtful = exceeds(fastest, piece.cap);
            if !gains && !doubtful {
                continue;
            }
            let t_s = profile.time_at(piece.end_s);
            let before_braking = t_s < braking_from_s;
            let passing = profile.sample(t_s).0.velocity;
            if doubtful
                && (exceeds(passing, piece.cap)
                    || (before_braking && exceeds(found.between, next.velocity)))
            {
                return Err(index);
            }
            if gains && before_braking {
                faster_s = Some(t_s);
            }
        }
        Ok(faster_s)
    }

    /// For who is too fast for the speed and too close to the end of its piece: slows down as fast as possible, and
    /// passes that end while it does. `None` if that exceeds what the next pieces allow, or there are none.
    fn slowing(&self) -> Option<PlannedMotion> {
        let bounds = self.bounds;
        let here = bounds.piece_at(self.start.position);
        if bounds.is_last(here) {
            return None;
        }
        let piece = bounds.piece(here)?;
        let target = self.speed * piece.exit;
        if let Some(Ok(planned)) = self.to_piece_end(here, target) {
            return Some(planned);
        }
        let KinematicState {
            velocity,
            acceleration,
            ..
        } = self.start;
        let change = VelocityChange::new(
            velocity - target,
            acceleration,
            bounds.acceleration_limits(),
        );
        let profile = change.profile(self.start);
        let until_s = profile.time_at(piece.end_s);
        let (passing, _) = profile.sample(until_s);
        let kept = passing.velocity <= piece.exit * (1.0 + SAME) && passing.acceleration <= 0.0;
        kept.then_some(PlannedMotion {
            profile,
            end: MotionEnd::Passing,
            until_s,
        })
    }
}

#[cfg(test)]
mod tests;
