//! Axes stored in the arena of a net: shared by primitives with goals. Run by the real-time thread.

use super::{AXIS_WORDS, AxisFollower, AxisState, MotionLimits};
use crate::frame::Frame;
use crate::primitive::{Bool, Real, Slot};

/// The words of an axis.
pub type AxisSlot = Slot<[Real; AXIS_WORDS]>;

/// Returns the slots of `count` axes that begin at `first`.
pub fn axes(first: AxisSlot, count: u32) -> impl Iterator<Item = AxisSlot> {
    (0..count).map(move |axis| first + axis * AXIS_WORDS as u32)
}

/// A velocity share below this counts as 0.
const SHARE_MIN: f64 = 1e-4;

/// Returns the words of an axis at rest at `position`, without a goal.
#[must_use]
pub fn rest_at(position: f64) -> [f64; AXIS_WORDS] {
    AxisFollower::at_rest(position).words()
}

/// Returns the words of an axis that continues a motion; one that is at rest begins as [`rest_at`].
#[must_use]
pub fn continued(state: AxisState) -> [f64; AXIS_WORDS] {
    match state.rests() {
        true => rest_at(state.position),
        false => AxisFollower::moving(state).words(),
    }
}

/// Returns true if the axis at `slot` has not been stepped yet. A primitive that moves from an arm's hold position then
/// outputs that position first, because the jerk from one set-point to the next is defined only from there on.
#[must_use]
pub fn is_new(frame: &Frame<'_>, slot: AxisSlot) -> Option<bool> {
    Some(AxisFollower::from_words(&frame.get(slot)?).is_new())
}

/// Returns the share of the velocity limit that the inputs `speed` and `stop` allow, 0 to 1: 0 while `stop` is true or
/// null, or `speed` is null; a speed above 1 counts as 1, and one below 0.0001 as 0.
#[must_use]
pub fn share_of(frame: &Frame<'_>, speed: Slot<Real>, stop: Slot<Bool>) -> Option<f64> {
    let speed = frame.get(speed)?;
    let share = if frame.get(stop)? != 0 || speed.is_nan() || speed < SHARE_MIN {
        0.0
    } else if speed > 1.0 {
        1.0
    } else {
        speed
    };
    Some(share)
}

/// Steps the axis at `slot` by one cycle towards `goal`, or to rest; `None` while its position is unknown, and in a cycle
/// whose motion overflows: the axis then stays where it is.
pub fn step_axis(
    frame: &mut Frame<'_>,
    slot: AxisSlot,
    goal: Option<f64>,
    limits: &MotionLimits,
) -> Option<AxisFollower> {
    let mut follower = AxisFollower::from_words(&frame.get(slot)?);
    if !follower.state().is_finite() {
        return None;
    }
    let (dt_s, motions) = (frame.dt_s, &mut *frame.motions);
    follower.step(goal, limits, dt_s, |from, goal, limits| {
        motions.plan_axis(from, goal, limits)
    });
    if !follower.state().is_finite() {
        return None;
    }
    frame.put(slot, follower.words())?;
    Some(follower)
}
