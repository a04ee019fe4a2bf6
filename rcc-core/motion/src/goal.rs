//! Time-optimal motion of one axis from any state to a goal within its limits, replanned whenever the goal changes. Run
//! by the real-time thread: a pure function of its arguments that does not allocate and cannot fail.
//!
//! Uses rsruckig's solver for the extremal profiles of one axis (step 1), not its public interface: the interface
//! formats refusals with `format!`, the solver returns `false`. Its tolerances are absolute, so the problem is scaled
//! such that the motion takes about a second; the result is then checked against goal and limits. If no valid result is
//! found, the axis brakes to rest and starts again from there, in closed form.

use std::cmp::Ordering;

use rcc_core::axis::{
    AxisState, AxisTask, Phases, limits_are_valid, rest_to_rest, stop_and_go, to_velocity,
};
use rcc_core::path::MotionLimits;
use rsruckig::block::Block;
use rsruckig::position_third_step1::PositionThirdOrderStep1;
use rsruckig::position_third_step2::PositionThirdOrderStep2;
use thiserror::Error;

use problem::{GoalProblem, ScaledProblem, start};

mod problem;

/// Relative tolerance for missing the goal or a limit, as a fraction of the quantity's range over the motion.
const TOLERANCE: f64 = 1e-9;

/// A velocity within this fraction of the limit counts as being at the limit.
const NEAR_LIMIT: f64 = 1e-6;

/// How a motion to a goal was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GoalPlanKind {
    /// The time-optimal motion within the limits.
    Fastest,
    /// Brake to rest, then go: rsruckig found nothing that keeps the limits, or nothing faster.
    AfterStop,
}

/// Why there is no motion to a goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum GoalFault {
    /// See [`rcc_core::axis::limits_are_valid`].
    #[error("a limit of velocity, acceleration or jerk is not a finite number above 0")]
    Limits,
    /// The state, the goal or the distance between them.
    #[error("the state or the goal is not a finite number, or they are too far apart")]
    NotFinite,
    /// With numbers of 64 bits, no computed motion ends at the goal.
    #[error("the limits and the distance differ by too many orders of magnitude")]
    Inexact,
}

/// Plans the motion from `from` to rest at `goal`, as fast as `limits` allow.
///
/// A state beyond the limits (because they were lowered) is brought within them as fast as possible. Where [`plan_to`]
/// finds no motion, the axis is brought to rest wherever that is; without valid limits, or from a state that is not
/// finite, the motion has no phases.
#[must_use]
pub fn plan(from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
    match plan_to(from, &AxisState::at_rest(goal), limits) {
        Ok((way, _)) => way,
        Err(GoalFault::Limits) => Phases::default(),
        Err(GoalFault::NotFinite) if !from.is_finite() => Phases::default(),
        Err(GoalFault::NotFinite | GoalFault::Inexact) => {
            Phases::of(&[&to_velocity(from, 0.0, limits)])
        }
    }
}

/// As [`plan`], to a goal that is reached with a given velocity and acceleration within the limits. If the axis has to
/// stop first, it reaches the goal at rest.
///
/// # Errors
/// Returns the reason why there is no motion that ends at the goal.
pub fn plan_to(
    from: &AxisState,
    to: &AxisState,
    limits: &MotionLimits,
) -> Result<(Phases, GoalPlanKind), GoalFault> {
    if !limits_are_valid(limits) {
        return Err(GoalFault::Limits);
    }
    if !(from.is_finite() && to.is_finite()) {
        return Err(GoalFault::NotFinite);
    }
    // Plan relative to the start: a large absolute position would cost precision on a short motion.
    let beginning = from.position;
    let at = |state: &AxisState| AxisState {
        position: state.position - beginning,
        ..*state
    };
    let (from, to) = (&at(from), &at(to));
    if !to.is_finite() {
        return Err(GoalFault::NotFinite);
    }
    if from.rests() && to.rests() {
        let way = Phases::of(&[&rest_to_rest(to.position, limits)]);
        return if ends_at(&way, from, to, limits) {
            Ok((way, GoalPlanKind::Fastest))
        } else {
            Err(GoalFault::Inexact)
        };
    }
    let found = fastest(from, to, limits).filter(|way| keeps(way, from, to, limits));
    // At the velocity limit, rounding decides which profiles rsruckig considers, and its brake trajectory may reverse.
    let at_limit = most_velocity(from, limits) > limits.velocity * (1.0 - NEAR_LIMIT);
    let brake = at_limit.then(|| brake_first(from, limits, |at, _| fastest(at, to, limits)));
    let brake = brake.flatten().filter(|way| keeps(way, from, to, limits));
    let stop = stop_and_go(from, to.position, limits);
    let stop = to.rests().then_some(stop);
    let ways = [found, brake, stop].into_iter().flatten();
    // Prefer motions that do not exceed the velocity limit for longer than necessary, then those that do not reverse,
    // then the shortest; of those that differ only by rounding, the first.
    let faults = |way: &Phases| (exceeds_longer(way, from, limits), turns_back(way, from));
    let better = |b: &Phases, a: &Phases| match faults(b).cmp(&faults(a)) {
        Ordering::Less => true,
        Ordering::Greater => false,
        Ordering::Equal => b.duration_s() < a.duration_s() * (1.0 - TOLERANCE),
    };
    let best = ways.reduce(|a, b| if better(&b, &a) { b } else { a });
    let way = best.unwrap_or_else(|| stop_and_go(from, to.position, limits));
    let kind = if best.is_none() || best == stop {
        GoalPlanKind::AfterStop
    } else {
        GoalPlanKind::Fastest
    };
    let end = match kind {
        GoalPlanKind::Fastest => *to,
        GoalPlanKind::AfterStop => AxisState::at_rest(to.position),
    };
    if ends_at(&way, from, &end, limits) {
        Ok((way, kind))
    } else {
        Err(GoalFault::Inexact)
    }
}

/// Plans the motion of a task that takes `duration_s` (s); `None` if none is found that keeps the limits, and from beyond the
/// velocity limit neither stays there longer than necessary nor reverses.
#[must_use]
pub fn plan_lasting(task: &AxisTask, duration_s: f64) -> Option<Phases> {
    let beginning = task.from.position;
    let from = AxisState {
        position: 0.0,
        ..task.from
    };
    let to = AxisState::at_rest(task.goal - beginning);
    if !(limits_are_valid(&task.limits) && from.is_finite() && to.is_finite()) {
        return None;
    }
    let limits = &task.limits;
    let at_limit = most_velocity(&from, limits) > limits.velocity * (1.0 - NEAR_LIMIT);
    let sound = |way: &Phases| {
        let lasts = (way.duration_s() - duration_s).abs() <= TOLERANCE * duration_s;
        let returns = || exceeds_longer(way, &from, limits) || turns_back(way, &from);
        lasts && keeps(way, &from, &to, limits) && !(at_limit && returns())
    };
    let brake_first = || {
        brake_first(&from, limits, |at, brake_s| {
            lasting(at, &to, limits, duration_s - brake_s)
        })
    };
    let found = lasting(&from, &to, limits, duration_s).filter(sound);
    found.or_else(|| at_limit.then(brake_first).flatten().filter(sound))
}

/// Runs rsruckig's solver for a motion of this duration, s.
fn lasting(
    from: &AxisState,
    to: &AxisState,
    limits: &MotionLimits,
    duration_s: f64,
) -> Option<Phases> {
    let problem = GoalProblem::lasting(from, to, limits, duration_s);
    let mut profile = problem.braked();
    let left = duration_s / problem.unit_s - profile.brake.duration;
    let [p0, v0, a0] = start(&profile);
    let ScaledProblem {
        to: (vf, af),
        way,
        limits: [v, a, j],
        ..
    } = problem.scaled;
    let mut step = PositionThirdOrderStep2::new(left, p0, v0, a0, way, vf, af, v, -v, a, -a, j);
    step.get_profile(&mut profile)
        .then(|| problem.phases(&profile, limits.jerk))
}

/// Returns true if a motion that begins beyond the velocity limit, or cannot avoid it, stays beyond it for longer than the
/// fastest change to the limit takes.
fn exceeds_longer(way: &Phases, from: &AxisState, limits: &MotionLimits) -> bool {
    let limit = limits.velocity;
    if most_velocity(from, limits) <= limit {
        return false;
    }
    let inevitable = from.coasting(limits.jerk);
    let direction = if inevitable.abs() > limit {
        inevitable
    } else {
        from.velocity
    };
    let change = to_velocity(from, limit.copysign(direction), limits);
    let necessary_s: f64 = change.iter().map(|(duration_s, _)| duration_s).sum();
    within_velocity_after_s(way, from, limit * (1.0 + NEAR_LIMIT))
        > necessary_s * (1.0 + NEAR_LIMIT)
}

/// Returns the time after which a motion stays within a velocity, s.
fn within_velocity_after_s(way: &Phases, from: &AxisState, velocity: f64) -> f64 {
    let (mut state, mut begin_s, mut last_s) = (*from, 0.0, 0.0);
    for (duration_s, jerk) in way.0 {
        let end = state.after(duration_s, jerk);
        if end.velocity.abs() > velocity {
            last_s = begin_s + duration_s;
        } else {
            for bound in [velocity, -velocity] {
                // The times at which the velocity passes the bound: jerk t² / 2 + a t + (v - bound) = 0.
                let [a, b, c] = [jerk / 2.0, state.acceleration, state.velocity - bound];
                let root = (b * b - 4.0 * a * c).sqrt();
                let sum = -(b + root.copysign(b)) / 2.0;
                for passed_s in [sum / a, c / sum] {
                    if passed_s > 0.0 && passed_s <= duration_s {
                        last_s = f64::max(last_s, begin_s + passed_s);
                    }
                }
            }
        }
        begin_s += duration_s;
        state = end;
    }
    last_s
}

/// Returns true if the motion reverses relative to its initial direction. Braking to a lower limit as fast as possible
/// leaves an acceleration that can carry the axis beyond rest: time-optimal, but lowering a speed must not make the
/// axis go back.
fn turns_back(way: &Phases, from: &AxisState) -> bool {
    let direction = from.velocity.signum();
    let velocities = || way.extrema(*from).map(|state| state.velocity * direction);
    let (least, most) = velocities().fold((0.0_f64, 0.0_f64), |(least, most), velocity| {
        (least.min(velocity), most.max(velocity))
    });
    least < -TOLERANCE * most.max(-least)
}

/// Brakes into the velocity limit and continues as `rest` does from there, after that many s; `None` if it finds nothing.
fn brake_first(
    from: &AxisState,
    limits: &MotionLimits,
    rest: impl FnOnce(&AxisState, f64) -> Option<Phases>,
) -> Option<Phases> {
    let MotionLimits { velocity, jerk, .. } = *limits;
    let left = from.coasting(jerk);
    let cruise = if left.abs() > velocity * (1.0 - NEAR_LIMIT) {
        velocity.copysign(left)
    } else {
        left
    };
    let brake = to_velocity(from, cruise, limits);
    let braking = Phases::of(&[&brake]);
    let mut at = braking.end(*from);
    (at.velocity, at.acceleration) = (cruise, 0.0);
    let rest = rest(&at, braking.duration_s())?;
    // At a limit there is nothing to brake: its first two phases are empty.
    Some(Phases::of(&[&brake, rest.0.get(2..)?]))
}

/// Runs rsruckig's solver. A long phase at constant speed is cut out before and inserted again afterwards.
fn fastest(from: &AxisState, to: &AxisState, limits: &MotionLimits) -> Option<Phases> {
    let problem = GoalProblem::of(from, to, limits);
    let profile = problem.braked();
    let [p0, v0, a0] = start(&profile);
    let ScaledProblem {
        to: (vf, af),
        way,
        limits: [v, a, j],
        ..
    } = problem.scaled;
    let mut step = PositionThirdOrderStep1::new(p0, v0, a0, way, vf, af, v, -v, a, -a, j);
    let mut block = Block::default();
    step.get_profile(&profile, &mut block)
        .then(|| problem.phases(&block.p_min, limits.jerk))
}

/// The velocity limit, or the velocity that the state makes inevitable if that is greater.
fn most_velocity(from: &AxisState, limits: &MotionLimits) -> f64 {
    let inevitable = from.velocity.abs().max(from.coasting(limits.jerk).abs());
    limits.velocity.max(inevitable)
}

/// Returns true if a motion ends at its goal and keeps the limits, except for what its initial state makes inevitable.
fn keeps(way: &Phases, from: &AxisState, to: &AxisState, limits: &MotionLimits) -> bool {
    let &MotionLimits {
        acceleration, jerk, ..
    } = limits;
    let most_acceleration = acceleration.max(from.acceleration.abs());
    let most_velocity = most_velocity(from, limits);
    let within = |value: f64, limit: f64| value.abs() <= limit * (1.0 + TOLERANCE);
    let steps = way.0.iter().all(|(t, j)| *t >= 0.0 && within(*j, jerk));
    let corners = way.extrema(*from).all(|corner| {
        within(corner.velocity, most_velocity) && within(corner.acceleration, most_acceleration)
    });
    steps && corners && ends_at(way, from, to, limits)
}

/// Returns true if a motion ends at its goal. False for a motion that is not finite.
fn ends_at(way: &Phases, from: &AxisState, to: &AxisState, limits: &MotionLimits) -> bool {
    let most_velocity = most_velocity(from, limits);
    let most_acceleration = limits.acceleration.max(from.acceleration.abs());
    let end = way.end(*from);
    let way_m = (to.position - from.position).abs() + most_velocity * way.duration_s();
    (end.position - to.position).abs() <= TOLERANCE * way_m
        && (end.velocity - to.velocity).abs() <= TOLERANCE * most_velocity
        && (end.acceleration - to.acceleration).abs() <= TOLERANCE * most_acceleration
}

#[cfg(test)]
mod tests;
