//! Plans the motions of a path clock: the fastest one to the end of a piece from which the rest of the path can be kept,
//! and the one that slows down. No allocation, no failure; run by the real-time thread when a path clock replans.

use rcc_core::axis::AxisState;

use super::approach::{Approach, ApproachTarget, approach};
use super::{MotionEnd, PathBounds, PlannedMotion};
use crate::jerk_profile::{JerkProfile, VelocityChange};

/// Relative difference below which velocities count as equal.
const SAME: f64 = 1e-10;

/// Plans motions from a state at a speed override.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotionPlanner<'a> {
    pub(super) bounds: &'a PathBounds,
    pub(super) start: AxisState,
    pub(super) speed: f64,
}

impl MotionPlanner<'_> {
    /// The fastest motion that is known to keep every limit up to its end, and from which the rest of the path can be
    /// kept.
    pub(super) fn fastest_motion(&self) -> Option<PlannedMotion> {
        let here = self.bounds.piece_at(self.start.position);
        let piece = self.bounds.piece(here)?;
        let cruise = self.speed * piece.velocity;
        let too_fast = match self.plan_to_piece_end(piece.braking_piece, cruise)? {
            Ok(planned) => return Some(planned),
            Err(too_fast) => too_fast,
        };
        if let Some(Ok(planned)) = self.plan_to_piece_end(too_fast, cruise) {
            return Some(planned);
        }
        let caps = (here..piece.braking_piece).filter_map(|index| self.bounds.piece(index));
        let least = caps.fold(piece.velocity, |least, piece| least.min(piece.cap));
        self.plan_to_piece_end(piece.braking_piece, self.speed * least)?
            .ok()
    }

    /// A motion to the exit velocity of piece `braking_piece`, cruising at `cruise`; or the index of the piece whose
    /// end it would pass too fast.
    fn plan_to_piece_end(
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

    /// When the motion to `braking_piece` enters a piece that allows more than it was planned for; or the index of the
    /// piece whose end it passes faster than that piece or the next one allows.
    fn faster(
        &self,
        found: &Approach,
        profile: &JerkProfile,
        braking_piece: usize,
        cruise: f64,
    ) -> Result<Option<f64>, usize> {
        let velocity = self.start.velocity;
        let coasting_velocity = self.start.coasting(self.bounds.jerk());
        let fastest = velocity.max(coasting_velocity).max(found.between);
        // A motion that begins too fast for the override only has to keep the limits themselves.
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

    /// For a state that is too fast for the override and too close to the end of its piece: slows down as fast as
    /// possible and passes that end meanwhile. `None` if that violates the limits of the next pieces, or there are no
    /// further pieces.
    pub(super) fn slowing(&self) -> Option<PlannedMotion> {
        let bounds = self.bounds;
        let here = bounds.piece_at(self.start.position);
        if bounds.is_last(here) {
            return None;
        }
        let piece = bounds.piece(here)?;
        let target = self.speed * piece.exit;
        if let Some(Ok(planned)) = self.plan_to_piece_end(here, target) {
            return Some(planned);
        }
        let AxisState {
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
