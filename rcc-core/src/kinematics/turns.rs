//! Whole turns of joints: the choice among q + 2π·n, and whether it is within the limits of the robot. Pure arithmetic;
//! used by the loader and by the real-time thread.

use core::f64::consts::{PI, TAU};
use core::fmt;

use crate::joints::{JointLimits, Joints};

/// Maximum number of turns of a joint in either direction.
const TURNS_MAX: f64 = 8.0;

/// Relative tolerance of position limits, the same as the guard's.
const TOLERANCE: f64 = 1e-9;

/// A joint that would exceed its limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutOfLimits {
    /// The joint, from 0.
    pub joint: u8,
    /// Required position, rad.
    pub value: f64,
    /// The limit that it exceeds, rad.
    pub limit: f64,
}

impl fmt::Display for OutOfLimits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "joint {} would be at {:.2}°, its limit is {:.2}°",
            u16::from(self.joint) + 1,
            self.value.to_degrees(),
            self.limit.to_degrees()
        )
    }
}

impl core::error::Error for OutOfLimits {}

/// Returns each joint shifted by the number of whole turns that brings it nearest to `hint` (rad), so that joints on a
/// path do not jump by a turn. A hint that is null or more than eight turns away leaves its joint unchanged.
#[must_use]
pub fn nearest_turns(joints: &Joints, hint: &Joints) -> Joints {
    let mut turned = *joints;
    for (joint, near) in turned.iter_mut().zip(hint) {
        let away = near - *joint;
        // The common case; rounding is expensive where the processor has no instruction for it.
        if away.abs() <= PI {
            continue;
        }
        let turns = libm::rint(away * (1.0 / TAU));
        if turns.abs() <= TURNS_MAX {
            *joint += turns * TAU;
        }
    }
    turned
}

/// Returns each joint shifted by whole turns into its limits, as near as possible to `hint` (rad).
///
/// # Errors
/// Returns the first joint that no number of turns brings within its limits, with the turn nearest to `hint`.
pub fn turns_within(
    joints: &Joints,
    hint: &Joints,
    limits: &JointLimits,
) -> Result<Joints, OutOfLimits> {
    let mut turned = nearest_turns(joints, hint);
    let ranges = limits.lower.iter().zip(&limits.upper).take(limits.joints);
    for (joint, (lower, upper)) in turned.iter_mut().zip(ranges) {
        // The nearest allowed turn is next to the limit on the side of the hint, or does not exist.
        let (over, under) = (*joint - upper, lower - *joint);
        let back = |beyond: f64| libm::ceil((beyond - TOLERANCE) * (1.0 / TAU)) * TAU;
        let moved = if over > 0.0 {
            *joint - back(over)
        } else if under > 0.0 {
            *joint + back(under)
        } else {
            *joint
        };
        if beyond(moved, *lower, *upper).is_none() {
            *joint = moved;
        }
    }
    within_limits(&turned, limits)?;
    Ok(turned)
}

/// Returns each joint in the turn with a given sign: in [−2π, 0) if its bit is set, otherwise in [0, 2π). This is the
/// definition of KUKA's Turn (bit 0: axis 1, 1 for an angle < 0°). An angle within 10⁻⁹ rad of 0 has either sign.
#[must_use]
pub fn turns_by_signs(joints: &Joints, negative: u8) -> Joints {
    let mut turned = *joints;
    for (joint, bit) in turned.iter_mut().zip(0_u8..) {
        let wrapped = *joint - TAU * libm::rint(*joint * (1.0 / TAU));
        let wanted = negative >> bit & 1 == 1;
        *joint = if wrapped.abs() < TOLERANCE || wanted == (wrapped < 0.0) {
            wrapped
        } else if wanted {
            wrapped - TAU
        } else {
            wrapped + TAU
        };
    }
    turned
}

/// Checks joint positions against their limits, with the guard's tolerance.
///
/// # Errors
/// Returns the first joint that exceeds its limits.
pub fn within_limits(joints: &Joints, limits: &JointLimits) -> Result<(), OutOfLimits> {
    let ranges = limits.lower.iter().zip(&limits.upper).take(limits.joints);
    for ((&value, (&lower, &upper)), joint) in joints.iter().zip(ranges).zip(0..) {
        if let Some(limit) = beyond(value, lower, upper) {
            return Err(OutOfLimits {
                joint,
                value,
                limit,
            });
        }
    }
    Ok(())
}

/// Returns the limit that a position exceeds; the comparison is written so that NaN exceeds.
fn beyond(value: f64, lower: f64, upper: f64) -> Option<f64> {
    let above = value >= lower - TOLERANCE * lower.abs();
    let below = value <= upper + TOLERANCE * upper.abs();
    match (above, below) {
        (true, true) => None,
        (false, _) => Some(lower),
        _ => Some(upper),
    }
}

#[cfg(test)]
mod tests;
