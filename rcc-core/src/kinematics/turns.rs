//! Whole turns of joints: which of q + 2π·n is meant, and whether it is within the limits of the robot.
//! Pure arithmetic; used by the loader and by the real-time thread.

use core::f64::consts::{PI, TAU};
use core::fmt;

use crate::guard::JointLimits;
use crate::message::Joints;

/// No joint has more turns than this to either side.
const TURNS_MAX: f64 = 8.0;

/// A position may be beyond its limit by this part of it: as the guard lets it be.
const TOLERANCE: f64 = 1e-9;

/// A joint that would have to be where its robot cannot be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutOfLimits {
    /// The joint, from 0.
    pub joint: u8,
    /// Where it would be, rad.
    pub value: f64,
    /// The limit that it is beyond, rad.
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

/// Each joint by as many whole turns away as brings it nearest to `hint` (rad): joints that move along a path do not jump by
/// a turn. A hint that is null or more than eight turns away leaves its joint as it is.
#[must_use]
pub fn nearest_turns(joints: &Joints, hint: &Joints) -> Joints {
    let mut turned = *joints;
    for (joint, near) in turned.iter_mut().zip(hint) {
        let away = near - *joint;
        // Most of the time; rounding is dear where the processor has no instruction for it.
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

/// Each joint by as many whole turns away as bring it within its limits, and among those nearest to `hint` (rad).
///
/// # Errors
/// The first joint that no number of turns brings within its limits, by the turn that is nearest to `hint`.
pub fn turns_within(
    joints: &Joints,
    hint: &Joints,
    limits: &JointLimits,
) -> Result<Joints, OutOfLimits> {
    let mut turned = nearest_turns(joints, hint);
    let ranges = limits.lower.iter().zip(&limits.upper).take(limits.joints);
    for (joint, (lower, upper)) in turned.iter_mut().zip(ranges) {
        // The nearest of all that are allowed is next to the limit on the side of the hint, or nowhere.
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

/// The turn of each joint that has a given sign: in [−2π, 0) where its bit is set, else in [0, 2π). This is what KUKA's Turn
/// says (bit 0: axis 1, 1 for an angle < 0°). An angle within 10⁻⁹ rad of 0 has either sign.
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

/// Says the first joint that is beyond its limits (by more than the guard lets it be).
///
/// # Errors
/// That joint.
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

/// The limit that a position is beyond; asked so that NaN is beyond.
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
