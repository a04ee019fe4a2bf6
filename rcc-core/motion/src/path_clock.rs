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

use rcc_core::path::{Drive, PathLimits, PathState};

use crate::profile::{Agility, Change, Profile, State, settled};

mod approach;
mod bounds;
mod words;

use approach::{Aim, Approach, approach};
pub use bounds::{PathBounds, PathLimitsError, PathPiece};
pub use words::CLOCK_WORDS;

/// A speed below this part of the limits is none.
const SPEED_MIN: f64 = 1e-6;

/// Velocities that differ by less than this part are the same.
const SAME: f64 = 1e-10;

/// Most ends of motions in one cycle. Pieces last a cycle or longer, so two are met.
const ENDS_MAX: usize = 8;

/// What a clock was told.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum Demand {
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

impl Demand {
    fn of(drive: Drive) -> Self {
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
enum End {
    /// At rest, wherever that is.
    #[default]
    Rest,
    /// At the end of a piece, without acceleration, at a velocity from which the rest of the path can be kept.
    Station {
        /// Place and velocity.
        s: f64,
        velocity: f64,
    },
    /// At the end of a piece that it passes while it slows down.
    Passing,
}

/// A motion, and when it is to be replaced.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Making {
    profile: Profile,
    end: End,
    /// When something new is made, s from its beginning: at its end, or where a faster piece begins.
    until_s: f64,
}

impl Making {
    /// The fastest stop.
    fn stop(start: State, limits: Agility) -> Self {
        let profile = Change::new(start.velocity, start.acceleration, limits).profile(start);
        Self {
            profile,
            end: End::Rest,
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
    demand: Demand,
    making: Making,
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
    pub(crate) fn moving(from: State) -> Self {
        Self {
            demand: Demand::Run(1.0),
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
    pub fn roll(&mut self, bounds: &PathBounds, drive: Drive) {
        if let (Demand::None, Demand::Run(speed)) = (self.demand, Demand::of(drive)) {
            self.last.velocity = speed * bounds.least_velocity();
        }
    }

    /// The state of this cycle: s = 0 at rest in the first step, one cycle further in each one after it.
    ///
    /// `bounds` are the same in every step. A `stop` cannot be taken back; a pause can, and so can any speed: it scales
    /// every velocity limit (0..1, below 10⁻⁶ or NaN: a pause). At the end s is exactly the length; after a stop it
    /// stays where the stop ended.
    pub fn step(&mut self, bounds: &PathBounds, drive: Drive) -> PathState {
        self.advance(bounds, drive, |_, _, _| ())
    }

    /// [`PathClock::step`], which tells every part of a motion that was made: the motion, from when, until when (s).
    fn advance(
        &mut self,
        bounds: &PathBounds,
        drive: Drive,
        mut made: impl FnMut(&Profile, f64, f64),
    ) -> PathState {
        let stopping = self.last.stopping || drive.stop;
        self.last.stopping = stopping;
        if self.last.done {
            return self.last;
        }
        let demand = Demand::of(Drive {
            stop: stopping,
            ..drive
        });
        let first = self.demand == Demand::None;
        if demand != self.demand {
            self.hear(bounds, demand);
        }
        let mut from_s = self.elapsed_s(bounds);
        self.cycle = self.cycle.saturating_add(u64::from(!first));
        for _ in 0..ENDS_MAX {
            let (t_s, until_s) = (self.elapsed_s(bounds), self.making.until_s);
            if t_s < until_s {
                made(&self.making.profile, from_s, t_s);
                let (state, jerk) = self.making.profile.sample(t_s);
                return self.tell(bounds, state, jerk);
            }
            if from_s < until_s {
                made(&self.making.profile, from_s, until_s);
            }
            if let Some(rest) = self.turn(bounds, t_s - until_s) {
                return rest;
            }
            from_s = self.elapsed_s(bounds) - (t_s - until_s);
        }
        let (state, jerk) = self.making.profile.sample(self.making.until_s);
        self.tell(bounds, state, jerk)
    }

    /// Time since the motion being made began, s.
    fn elapsed_s(&self, bounds: &PathBounds) -> f64 {
        #[allow(clippy::cast_precision_loss)] // 2^53 cycles are 285,000 years at 1 kHz.
        let cycles = self.cycle as f64;
        self.offset_s + cycles * bounds.dt_s()
    }

    /// Makes what is demanded from the last state on, if it was not what is being made already.
    fn hear(&mut self, bounds: &PathBounds, demand: Demand) {
        let before = std::mem::replace(&mut self.demand, demand);
        let start = State {
            position: self.last.s,
            velocity: self.last.velocity,
            acceleration: self.last.acceleration,
        };
        let new = match demand {
            Demand::Run(speed) => {
                let slower = !matches!((before, self.making.end),
                    (Demand::Run(before), End::Station { .. }) if before <= speed);
                let ways = Ways {
                    bounds,
                    start,
                    speed,
                };
                let new = ways.best();
                new.or_else(|| ways.slowing().filter(|_| slower))
            }
            _ if before == Demand::Pause => None,
            _ => Some(Making::stop(start, bounds.agility())),
        };
        // Without a better one the motion being made goes on; at the beginning that is a rest at 0.
        if let Some(new) = new {
            (self.making, self.offset_s, self.cycle) = (new, 0.0, 0);
        }
    }

    /// The motion being made is over, or enters a faster piece, since `over_s`: makes the next one, or tells the rest.
    fn turn(&mut self, bounds: &PathBounds, over_s: f64) -> Option<PathState> {
        let Making {
            profile,
            end,
            until_s,
        } = self.making;
        let passing = until_s < profile.duration_s();
        let state = match end {
            End::Station { s, velocity } if !passing => State {
                position: s,
                velocity,
                acceleration: 0.0,
            },
            End::Rest => State {
                position: profile.end_position(),
                ..State::default()
            },
            _ => profile.sample(until_s).0,
        };
        let at_end = state.position >= bounds.length() - bounds.slack();
        let resting = end == End::Rest || at_end;
        let speed = match self.demand {
            Demand::Run(speed) if !at_end => speed,
            _ if resting => return Some(self.rest(bounds, state.position, at_end)),
            // A pause is a way to rest.
            _ => return Some(self.tell(bounds, state, 0.0)),
        };
        let ways = Ways {
            bounds,
            start: state,
            speed,
        };
        let new = match (ways.best(), end) {
            (None, End::Station { .. }) if passing => {
                // What is being made goes on to the end.
                self.making.until_s = profile.duration_s();
                return None;
            }
            (new, _) => new.or_else(|| ways.slowing()),
        };
        self.making = new.unwrap_or_else(|| Making::stop(state, bounds.agility()));
        (self.offset_s, self.cycle) = (over_s, 0);
        None
    }

    /// At rest at `s`.
    fn rest(&mut self, bounds: &PathBounds, s: f64, at_end: bool) -> PathState {
        let position = if at_end { bounds.length() } else { s };
        self.last.done = at_end || self.demand == Demand::Stop;
        let rest = State {
            position,
            ..State::default()
        };
        self.tell(bounds, rest, 0.0)
    }

    /// Rounding may neither lead backwards nor beyond the end.
    fn tell(&mut self, bounds: &PathBounds, state: State, jerk: f64) -> PathState {
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
    clock.hear(bounds, Demand::Run(1.0));
    let mut sum_s = 0.0;
    // Each piece is entered once; what cannot be gone on with comes to rest and starts again.
    for _ in 0..4 * bounds.pieces() + 4 {
        sum_s += clock.making.until_s;
        if clock.turn(bounds, 0.0).is_some() {
            break;
        }
    }
    sum_s
}

/// The greatest velocity of a motion along a whole path of one piece.
pub(crate) fn peak(bounds: &PathBounds) -> f64 {
    let mut clock = PathClock::new();
    clock.hear(bounds, Demand::Run(1.0));
    let corners = clock.making.profile.corners();
    corners.map(|corner| corner.velocity).fold(0.0, f64::max)
}

/// Most cycles for which a rolling clock is watched: a quarter of an hour at 1 kHz.
const ROLLING_MAX: usize = 1_000_000;

/// How long it takes a clock that rolls ([`PathClock::roll`]) to pass `end` at full speed, s; infinite if it does not, or
/// not within [`ROLLING_MAX`] cycles: a path that crawls past a singular position may take days.
pub(crate) fn rolling_s(bounds: &PathBounds, end: f64) -> f64 {
    let mut clock = PathClock::new();
    clock.roll(bounds, Drive::RUN);
    let mut time_s = 0.0;
    for _ in 0..ROLLING_MAX {
        if clock.step(bounds, Drive::RUN).s >= end {
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
    let agility = Agility {
        acceleration: limits.acceleration,
        jerk: limits.jerk,
    };
    Change::new(velocity, acceleration, agility).duration_s()
}

/// The ways on from a state at a speed.
#[derive(Debug, Clone, Copy)]
struct Ways<'a> {
    bounds: &'a PathBounds,
    start: State,
    speed: f64,
}

impl Ways<'_> {
    /// The fastest motion known to keep every limit up to where it ends, and from there on.
    fn best(&self) -> Option<Making> {
        let here = self.bounds.piece_at(self.start.position);
        let piece = self.bounds.piece(here)?;
        let cruise = self.speed * piece.velocity;
        let too_fast = match self.to(piece.station, cruise)? {
            Ok(making) => return Some(making),
            Err(too_fast) => too_fast,
        };
        if let Some(Ok(making)) = self.to(too_fast, cruise) {
            return Some(making);
        }
        let caps = (here..piece.station).filter_map(|index| self.bounds.piece(index));
        let least = caps.fold(piece.velocity, |least, piece| least.min(piece.cap));
        self.to(piece.station, self.speed * least)?.ok()
    }

    /// To the velocity at the end of piece `station`, cruising with `cruise`; or the piece whose end would be passed
    /// too fast.
    fn to(&self, station: usize, cruise: f64) -> Option<Result<Making, usize>> {
        let piece = self.bounds.piece(station)?;
        let aim = Aim {
            way: (piece.end_s - self.start.position).max(0.0),
            cruise,
            exit: self.speed * piece.exit,
            slack: self.bounds.slack(),
        };
        let found = approach(self.start, &aim, self.bounds.agility())?;
        let profile = found.profile(self.start);
        let making = |until_s| Making {
            profile,
            end: End::Station {
                s: piece.end_s,
                velocity: found.exit,
            },
            until_s,
        };
        Some(match self.faster(&found, &profile, station, cruise) {
            Ok(faster_s) => Ok(making(faster_s.unwrap_or(profile.duration_s()))),
            Err(too_fast) => Err(too_fast),
        })
    }

    /// When the motion to `station` enters a piece that allows more than it was made for; or the piece whose end it
    /// passes faster than that or the next one allows.
    fn faster(
        &self,
        found: &Approach,
        profile: &Profile,
        station: usize,
        cruise: f64,
    ) -> Result<Option<f64>, usize> {
        let State {
            velocity,
            acceleration,
            ..
        } = self.start;
        let settled = settled(velocity, acceleration, self.bounds.jerk());
        let fastest = velocity.max(settled).max(found.between);
        // Who begins too fast for the speed keeps the limits themselves.
        let scale = if velocity.max(settled) > cruise {
            1.0
        } else {
            self.speed
        };
        let braking_from_s = found.braking_from_s();
        let limited = found.between >= cruise * (1.0 - SAME);
        let mut faster_s = None;
        for index in self.bounds.piece_at(self.start.position)..station {
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
    fn slowing(&self) -> Option<Making> {
        let bounds = self.bounds;
        let here = bounds.piece_at(self.start.position);
        if bounds.is_last(here) {
            return None;
        }
        let piece = bounds.piece(here)?;
        let target = self.speed * piece.exit;
        if let Some(Ok(making)) = self.to(here, target) {
            return Some(making);
        }
        let State {
            velocity,
            acceleration,
            ..
        } = self.start;
        let change = Change::new(velocity - target, acceleration, bounds.agility());
        let profile = change.profile(self.start);
        let until_s = profile.time_at(piece.end_s);
        let (passing, _) = profile.sample(until_s);
        let kept = passing.velocity <= piece.exit * (1.0 + SAME) && passing.acceleration <= 0.0;
        kept.then_some(Making {
            profile,
            end: End::Passing,
            until_s,
        })
    }
}

#[cfg(test)]
mod tests;
