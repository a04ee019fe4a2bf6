//! Motions of several axes that end at the same time. Run by the real-time thread: bounded, without allocation.

use super::{AxisState, MotionLimits, Phases, rest_to_rest, stop_and_go, to_velocity};
use crate::joints::JOINTS_MAX;

/// From a state to rest at a goal, within limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTask {
    /// Where it begins.
    pub from: AxisState,
    /// Position at the end.
    pub goal: f64,
    /// Limits of velocity, acceleration and jerk.
    pub limits: MotionLimits,
}

impl AxisTask {
    /// Stays at 0.
    pub const NONE: AxisTask = AxisTask {
        from: AxisState::at_rest(0.0),
        goal: 0.0,
        limits: MotionLimits::NONE,
    };
}

/// Searches for a common duration: that of the slowest axis, then that after a stop of the slowest of those which cannot take
/// so long, and at last that after a stop of the slowest of all, which all can take.
const SEARCHES: usize = 3;

/// A duration that is shorter than another one by less than this fraction counts as equal.
const SAME_DURATION: f64 = 1e-12;

/// Plans motions that end at the same time, the earliest that was found: `fastest` returns the soonest motion of an axis, and
/// `lasting` one of a given duration (s), if there is one. At most [`JOINTS_MAX`] axes.
pub fn plan_together(
    tasks: &[AxisTask],
    ways: &mut [Phases],
    fastest: impl Fn(&AxisTask) -> Phases,
    lasting: impl Fn(&AxisTask, f64) -> Option<Phases>,
) {
    let mut soonest = [Phases::default(); JOINTS_MAX];
    let mut end_s = 0.0;
    for (task, way) in tasks.iter().zip(&mut soonest) {
        *way = fastest(task);
        end_s = f64::max(end_s, way.duration_s());
    }
    let stop_and_go_s = |task: &AxisTask| {
        let AxisTask { from, goal, limits } = task;
        stop_and_go(from, *goal, limits).duration_s()
    };
    for search in 1..=SEARCHES {
        let mut later_s = end_s;
        for ((task, soonest), way) in tasks.iter().zip(&soonest).zip(ways.iter_mut()) {
            let slowed = slowed(task, soonest, end_s)
                .or_else(|| lasting(task, end_s))
                .or_else(|| stop_and_go_in(task, end_s));
            *way = slowed.unwrap_or(*soonest);
            if slowed.is_none() {
                later_s = later_s.max(stop_and_go_s(task));
            }
        }
        if later_s <= end_s {
            return;
        }
        if search + 1 == SEARCHES {
            later_s = tasks.iter().map(stop_and_go_s).fold(later_s, f64::max);
        }
        end_s = later_s;
    }
}

/// The soonest motion if it lasts `end_s` (s), or if it begins at rest and is slowed down to it.
fn slowed(task: &AxisTask, soonest: &Phases, end_s: f64) -> Option<Phases> {
    let own_s = soonest.duration_s();
    if own_s >= end_s * (1.0 - SAME_DURATION) {
        return Some(*soonest);
    }
    let distance = task.goal - task.from.position;
    let rests = task.from.rests();
    rests.then(|| Phases::of(&[&rest_to_rest_in(distance, &task.limits, end_s)]))
}

/// Stops, and goes to the goal from there in the time that is left; `None` if that is too short.
fn stop_and_go_in(task: &AxisTask, end_s: f64) -> Option<Phases> {
    let stop = to_velocity(&task.from, 0.0, &task.limits);
    let stopping = Phases::of(&[&stop]);
    let distance = task.goal - stopping.end(task.from).position;
    let left_s = end_s - stopping.duration_s();
    let least_s = duration_s(&rest_to_rest(distance, &task.limits));
    (left_s >= least_s * (1.0 - SAME_DURATION)).then(|| {
        let go = rest_to_rest_in(distance, &task.limits, left_s);
        Phases::of(&[&stop, &go])
    })
}

/// From rest to rest in `end_s` (s), which is not shorter than the soonest motion: the same profile, slower.
fn rest_to_rest_in(distance: f64, limits: &MotionLimits, end_s: f64) -> [(f64, f64); 7] {
    let soonest = rest_to_rest(distance, limits);
    let slower = duration_s(&soonest) / end_s;
    if slower >= 1.0 || distance == 0.0 {
        return soonest;
    }
    soonest.map(|(duration_s, jerk)| (duration_s / slower, jerk * slower * slower * slower))
}

fn duration_s(phases: &[(f64, f64)]) -> f64 {
    phases.iter().map(|(duration_s, _)| duration_s).sum()
}
