//! The limits of a path clock: a velocity limit for each piece of the path, and the look-ahead, i.e. how fast each
//! piece may be left so that all following limits can be kept. Computed when a motion is built (allocates), read by the
//! real-time thread.

use rcc_core::axis::AxisState;
use rcc_core::path::PathLimits;
use thiserror::Error;

use crate::jerk_profile::{AccelerationLimits, VelocityChange};

/// Fraction of a distance that the look-ahead leaves unused, so that rounding cannot make it too short.
const RESERVE: f64 = 1e-12;

/// Fraction of the path length below which two positions count as equal.
const SAME: f64 = 1e-14;

/// Bisections in the search for a velocity; the last ones are below the rounding of an f64.
const HALVINGS: usize = 60;

/// Why limits are refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PathLimitsError {
    /// The length is negative, NaN or infinite.
    #[error("path length {length}: give a finite number, 0 or more")]
    Length {
        /// The given value.
        length: f64,
    },
    /// A limit is zero, negative, NaN or infinite.
    #[error("path {limit} limit {value}: give a finite number greater than 0")]
    Limit {
        /// `velocity`, `acceleration` or `jerk`.
        limit: &'static str,
        /// The given value.
        value: f64,
    },
    /// A piece ends before it begins.
    #[error("piece {piece} of a path ends at {end_s}, before its beginning at {begin_s}")]
    Order {
        /// The piece, counted from 0.
        piece: usize,
        /// The end of the piece before it.
        begin_s: f64,
        /// The end of the piece.
        end_s: f64,
    },
    /// No pieces were given.
    #[error("a path without pieces: give at least one")]
    Empty,
    /// The cycle time is zero, negative, NaN or infinite.
    #[error("cycle time {dt_s} s: give a finite number greater than 0")]
    CycleTime {
        /// The given value, s.
        dt_s: f64,
    },
}

/// A part of a path with one velocity limit; it begins where the previous piece ends, the first one at 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPiece {
    /// Path parameter at its end; not less than at its beginning.
    pub end_s: f64,
    /// Largest ds/dt on it (> 0), per second.
    pub velocity: f64,
}

/// A piece with its look-ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LookAheadPiece {
    pub(super) end_s: f64,
    pub(super) velocity: f64,
    /// The lower of the velocity limits of the two pieces that meet at its end; 0 at the end of the path.
    pub(super) cap: f64,
    /// Velocity at its end (with zero acceleration) from which all following limits can be kept.
    pub(super) exit: f64,
    /// Index of the first piece, from this one on, at whose end a lower limit must be met: the next braking target.
    pub(super) braking_piece: usize,
}

/// Velocity, acceleration and jerk limits of a whole path, with the look-ahead over its pieces. Immutable.
#[derive(Debug, Clone, PartialEq)]
pub struct PathBounds {
    pieces: Box<[LookAheadPiece]>,
    acceleration_limits: AccelerationLimits,
    dt_s: f64,
    slack: f64,
}

impl PathBounds {
    /// Bounds for a path of `pieces` on which |d²s/dt²| is at most `acceleration` and |d³s/dt³| at most `jerk`, for
    /// clocks that advance by `dt_s` (s) per step.
    ///
    /// Neighbours with equal velocity become one piece. So does a piece that is passed in less than a step, with the
    /// lower limit of the two.
    ///
    /// # Errors
    /// Returns [`PathLimitsError`] if there are no pieces, they are out of order, or a limit is not a finite number
    /// greater than 0.
    pub fn new(
        pieces: &[PathPiece],
        acceleration: f64,
        jerk: f64,
        dt_s: f64,
    ) -> Result<Self, PathLimitsError> {
        check(pieces, acceleration, jerk, dt_s)?;
        let acceleration_limits = AccelerationLimits { acceleration, jerk };
        let mut all: Vec<PathPiece> = Vec::with_capacity(pieces.len());
        for piece in pieces {
            all.push(*piece);
            merge(&mut all, dt_s);
        }
        let pieces = look_ahead(&all, acceleration_limits);
        let length = all.last().map_or(0.0, |piece| piece.end_s);
        let slack = SAME * length;
        Ok(Self {
            pieces,
            acceleration_limits,
            dt_s,
            slack,
        })
    }

    /// Bounds for a path with one velocity limit.
    ///
    /// # Errors
    /// Returns [`PathLimitsError`] if a limit is not a finite number greater than 0 (the length may be 0).
    pub fn of_limits(limits: &PathLimits, dt_s: f64) -> Result<Self, PathLimitsError> {
        let piece = PathPiece {
            end_s: limits.length,
            velocity: limits.velocity,
        };
        Self::new(&[piece], limits.acceleration, limits.jerk, dt_s)
    }

    /// The same path with its velocities, its acceleration and its jerk multiplied by these factors (> 0).
    pub(crate) fn scaled(&self, [velocity, acceleration, jerk]: [f64; 3]) -> Option<Self> {
        let pieces = self.pieces.iter().map(|piece| PathPiece {
            end_s: piece.end_s,
            velocity: velocity * piece.velocity,
        });
        let pieces: Vec<_> = pieces.collect();
        let limits = [acceleration * self.acceleration(), jerk * self.jerk()];
        Self::new(&pieces, limits[0], limits[1], self.dt_s).ok()
    }

    /// Becomes the bounds for a path with one velocity limit, without allocating; limits that [`PathBounds::of_limits`]
    /// refuses must not be given.
    pub(crate) fn become_line(&mut self, limits: &PathLimits) {
        let last = self.pieces.len().saturating_sub(1);
        for piece in &mut self.pieces {
            *piece = LookAheadPiece {
                end_s: limits.length,
                velocity: limits.velocity,
                cap: 0.0,
                exit: 0.0,
                braking_piece: last,
            };
        }
        self.acceleration_limits = AccelerationLimits {
            acceleration: limits.acceleration,
            jerk: limits.jerk,
        };
        self.slack = SAME * limits.length;
    }

    /// Path parameter at the end.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.pieces.last().map_or(0.0, |piece| piece.end_s)
    }

    /// Duration of one step, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        self.dt_s
    }

    /// Largest |d²s/dt²|, per second squared.
    #[must_use]
    pub fn acceleration(&self) -> f64 {
        self.acceleration_limits.acceleration
    }

    /// Largest |d³s/dt³|, per second cubed.
    #[must_use]
    pub fn jerk(&self) -> f64 {
        self.acceleration_limits.jerk
    }

    /// Largest ds/dt at `s`, per second; at the boundary of two pieces the lower one.
    #[must_use]
    pub fn velocity_at(&self, s: f64) -> f64 {
        let first = self.pieces.partition_point(|piece| piece.end_s < s);
        let here = self.pieces.get(first).or(self.pieces.last());
        here.map_or(0.0, |piece| {
            if piece.end_s == s && piece.cap > 0.0 {
                piece.cap
            } else {
                piece.velocity
            }
        })
    }

    /// The lowest of the limits of ds/dt, per second.
    pub(crate) fn least_velocity(&self) -> f64 {
        let velocities = self.pieces.iter().map(|piece| piece.velocity);
        velocities.fold(f64::INFINITY, f64::min)
    }

    pub(crate) fn acceleration_limits(&self) -> AccelerationLimits {
        self.acceleration_limits
    }

    /// Returns true if the fastest stop from this state, which another motion has produced, keeps these limits on its
    /// whole way.
    pub(crate) fn allows_stop(&self, from: AxisState) -> bool {
        let AccelerationLimits { acceleration, jerk } = self.acceleration_limits;
        let rise = from.acceleration * from.acceleration / (2.0 * jerk);
        let (fastest, forward) = if from.acceleration > 0.0 {
            (from.velocity + rise, true)
        } else {
            (from.velocity, from.velocity >= rise)
        };
        let rests = self.acceleration_limits.stop(from).end(from).position;
        let mut pieces = self.piece_at(from.position)..=self.piece_at(rests);
        // Written such that a NaN allows nothing.
        forward
            && from.acceleration.abs() <= acceleration
            && rests <= self.length()
            && pieces.all(|index| {
                let piece = self.piece(index);
                piece.is_some_and(|piece| fastest <= piece.velocity)
            })
    }

    /// Positions closer than this count as equal.
    pub(super) fn slack(&self) -> f64 {
        self.slack
    }

    pub(super) fn piece(&self, index: usize) -> Option<&LookAheadPiece> {
        self.pieces.get(index)
    }

    /// Index of the piece that contains `s`, the later one at a boundary; the last piece at the end and beyond it.
    pub(super) fn piece_at(&self, s: f64) -> usize {
        let ended = |piece: &LookAheadPiece| piece.end_s <= s + self.slack;
        let index = self.pieces.partition_point(ended);
        index.min(self.pieces.len().saturating_sub(1))
    }

    /// Number of pieces.
    pub(super) fn pieces(&self) -> usize {
        self.pieces.len()
    }

    /// Whether this is the last piece.
    pub(super) fn is_last(&self, index: usize) -> bool {
        index + 1 >= self.pieces.len()
    }
}

fn check(
    pieces: &[PathPiece],
    acceleration: f64,
    jerk: f64,
    dt_s: f64,
) -> Result<(), PathLimitsError> {
    let positive = |limit, value: f64| {
        if value.is_finite() && value > 0.0 {
            Ok(())
        } else {
            Err(PathLimitsError::Limit { limit, value })
        }
    };
    if pieces.is_empty() {
        return Err(PathLimitsError::Empty);
    }
    let mut begin_s = 0.0;
    for (index, piece) in pieces.iter().enumerate() {
        let length = piece.end_s;
        if !length.is_finite() || (index == 0 && length < 0.0) {
            return Err(PathLimitsError::Length { length });
        }
        if piece.end_s < begin_s {
            return Err(PathLimitsError::Order {
                piece: index,
                begin_s,
                end_s: piece.end_s,
            });
        }
        begin_s = piece.end_s;
        positive("velocity", piece.velocity)?;
    }
    positive("acceleration", acceleration)?;
    positive("jerk", jerk)?;
    if dt_s.is_finite() && dt_s > 0.0 {
        Ok(())
    } else {
        Err(PathLimitsError::CycleTime { dt_s })
    }
}

/// Merges the last two pieces while they have the same velocity or one of them is passed in less than a step.
fn merge(pieces: &mut Vec<PathPiece>, dt_s: f64) {
    while let [before @ .., first, second] = pieces.as_mut_slice() {
        let begin_s = before.last().map_or(0.0, |piece| piece.end_s);
        let short = |begin_s: f64, piece: &PathPiece| piece.end_s - begin_s < piece.velocity * dt_s;
        let one = first.velocity == second.velocity
            || short(begin_s, first)
            || short(first.end_s, second);
        if !one {
            break;
        }
        first.velocity = first.velocity.min(second.velocity);
        first.end_s = second.end_s;
        pieces.pop();
    }
}

/// Computes from the end to the beginning how fast each piece may be left.
fn look_ahead(
    pieces: &[PathPiece],
    acceleration_limits: AccelerationLimits,
) -> Box<[LookAheadPiece]> {
    let last = pieces.len().saturating_sub(1);
    let mut all: Vec<LookAheadPiece> = Vec::with_capacity(pieces.len());
    // The braking target ahead: index of the piece, its end, the velocity there, and the lowest limit on the way to it.
    let (mut braking_piece, mut braking_s, mut there, mut cap_ahead) =
        (last, 0.0, 0.0, f64::INFINITY);
    for (index, piece) in pieces.iter().enumerate().rev() {
        let next = pieces.get(index + 1);
        let cap = next.map_or(0.0, |next| next.velocity.min(piece.velocity));
        let exit = if next.is_none() {
            0.0
        } else {
            let distance = (braking_s - piece.end_s) * (1.0 - RESERVE);
            fastest(cap.min(cap_ahead), there, distance, acceleration_limits)
        };
        let lower = next.is_none_or(|next| next.velocity < piece.velocity);
        if lower && exit >= cap {
            (braking_piece, braking_s, there, cap_ahead) =
                (index, piece.end_s, exit, f64::INFINITY);
        } else {
            cap_ahead = cap_ahead.min(cap);
        }
        all.push(LookAheadPiece {
            end_s: piece.end_s,
            velocity: piece.velocity,
            cap,
            exit,
            braking_piece,
        });
    }
    all.reverse();
    all.into_boxed_slice()
}

/// The greatest velocity up to `most` from which `there` is reached within the distance, with zero acceleration at both
/// ends.
fn fastest(most: f64, there: f64, distance: f64, acceleration_limits: AccelerationLimits) -> f64 {
    let fits = |velocity: f64| {
        let start = AxisState {
            velocity,
            ..AxisState::default()
        };
        velocity <= there
            || VelocityChange::new(velocity - there, 0.0, acceleration_limits)
                .end(start)
                .position
                <= distance
    };
    if fits(most) {
        return most;
    }
    let (mut slow, mut fast) = (there, most);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (slow + fast);
        *(if fits(middle) { &mut slow } else { &mut fast }) = middle;
    }
    slow
}
