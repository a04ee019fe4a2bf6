//! A straight line of the flange and the shortest turn, by one path parameter. Made off the real-time thread, evaluated
//! by it.
//!
//! s is in metres if the line decides the speed and in radians if the turn does, so that the limits of both hold.

use rcc_core::path::{Leg, Limits, MotionFault, PathLimits};
use rcc_core::pose::Pose;

/// Below this a line has no length and a turn no angle (m, rad).
const NOTHING: f64 = 1e-9;

/// A line from a pose to another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Line {
    from: Pose,
    to: Pose,
    length: f64,
    metres_per_s: f64,
}

impl Line {
    /// The line of a leg, and the limits of its path parameter.
    ///
    /// # Errors
    /// A turn by 180° has no direction.
    pub(crate) fn new(from: Pose, to: Pose, leg: &Leg) -> Result<(Line, PathLimits), MotionFault> {
        from.slerp(&to, 0.5).ok_or(MotionFault::AmbiguousRotation)?;
        let (line_m, angle_rad) = (from.distance_to(&to), from.angle_to(&to));
        let by_line =
            line_m > NOTHING && line_m * leg.turn.velocity >= angle_rad * leg.line.velocity;
        let length = if by_line { line_m } else { angle_rad };
        let limits = match (by_line, length > NOTHING) {
            (_, false) => leg.line,
            (true, true) => tighter(leg.line, leg.turn, angle_rad / line_m),
            (false, true) => tighter(leg.turn, leg.line, line_m / angle_rad),
        };
        let length = if length > NOTHING { length } else { 0.0 };
        let metres_per_s = if length > 0.0 { line_m / length } else { 0.0 };
        let limits = PathLimits {
            length,
            velocity: limits.velocity,
            acceleration: limits.acceleration,
            jerk: limits.jerk,
        };
        let line = Line {
            from,
            to,
            length,
            metres_per_s,
        };
        Ok((line, limits))
    }

    /// Where the flange is at s.
    pub(crate) fn at(&self, s: f64) -> Pose {
        let fraction = if self.length > 0.0 {
            s / self.length
        } else {
            0.0
        };
        self.from.slerp(&self.to, fraction).unwrap_or(self.from)
    }

    /// Metres of the flange per unit of s.
    pub(crate) fn metres_per_s(&self) -> f64 {
        self.metres_per_s
    }
}

/// Limits of the leading quantity such that `ratio` times it keeps the limits of the following one.
fn tighter(leading: Limits, following: Limits, ratio: f64) -> Limits {
    let limit = |leading: f64, following: f64| {
        if ratio > 0.0 {
            leading.min(following / ratio)
        } else {
            leading
        }
    };
    Limits {
        velocity: limit(leading.velocity, following.velocity),
        acceleration: limit(leading.acceleration, following.acceleration),
        jerk: limit(leading.jerk, following.jerk),
    }
}
