//! Axes in the arena of a net: what primitives with goals have in common. Run by the real-time thread.

use super::{AXIS_WORDS, AxisFollower};
use crate::frame::Frame;
use crate::path::MotionLimits;

/// A share of the greatest velocity below this is none.
const SHARE_MIN: f64 = 1e-4;

/// The words of an axis that rests there, without a goal.
#[must_use]
pub fn rest_at(position: f64) -> [f64; AXIS_WORDS] {
    AxisFollower::at_rest(position).words()
}

/// The axis whose words are at `slot` has not been stepped yet. What goes to a goal from where an arm is held says that place
/// first: the jerk from a set-point to the next ones is known from then on only.
#[must_use]
pub fn is_new(frame: &Frame<'_>, slot: u32) -> bool {
    AxisFollower::from_words(&frame.reals(slot)).is_new()
}

/// The share of the greatest velocity that the inputs `speed` and `stop` leave, 0 to 1: none while `stop` is true or null,
/// or `speed` null; a speed above 1 is 1, and one below 0.0001 is 0.
#[must_use]
pub fn share_of(frame: &Frame<'_>, speed: u32, stop: u32) -> f64 {
    let speed = frame.real(speed);
    if frame.bool(stop) != 0 || speed.is_nan() || speed < SHARE_MIN {
        0.0
    } else if speed > 1.0 {
        1.0
    } else {
        speed
    }
}

/// Steps the axis whose words are at `slot` by one cycle towards `goal`, or to rest; `None` while it does not know where it
/// is.
pub fn step_axis(
    frame: &mut Frame<'_>,
    slot: u32,
    goal: Option<f64>,
    limits: &MotionLimits,
) -> Option<AxisFollower> {
    let mut follower = AxisFollower::from_words(&frame.get_reals(slot)?);
    if !follower.state().is_finite() {
        return None;
    }
    let (dt_s, motions) = (frame.dt_s, &mut *frame.motions);
    follower.step(goal, limits, dt_s, |from, goal, limits| {
        motions.plan_axis(from, goal, limits)
    });
    frame.put_reals(slot, follower.words())?;
    Some(follower)
}
