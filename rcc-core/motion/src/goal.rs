//! The fastest way of one axis to a goal from any state, within its limits: what is asked for anew whenever a goal changes.
//! Run by the real-time thread: a function of its arguments, without allocation, without failure.
//!
//! Of rsruckig it takes the mathematics (the extremal profiles of one axis), not the front: that one writes its refusals
//! with `format!`, here a refusal is a `false`. Its tolerances are absolute, so that it is asked in units in which the
//! way takes about a second; what it finds is judged by what it does. Where it finds nothing good the axis brakes to rest
//! and goes on from there, in closed form.

use rcc_core::axis::{AxisState, Phases, rest_to_rest, stop_and_go, to_velocity, limits_are_valid};
use rcc_core::path::MotionLimits;
use rsruckig::block::Block;
use rsruckig::position_third_step1::PositionThirdOrderStep1;
use rsruckig::prelude::Profile;

/// A way may miss its goal or a limit by this part of what it goes through.
const TOLERANCE: f64 = 1e-9;

/// So near to the velocity limit, as a part of it, a state is taken to be at the limit.
const NEAR_LIMIT: f64 = 1e-6;

/// How a way was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GoalPlanKind {
    /// The fastest one that keeps the limits.
    Fastest,
    /// To rest first: rsruckig had nothing that keeps the limits, or nothing faster.
    AfterStop,
}

/// From `from` to rest at `goal`, as fast as `limits` allow.
///
/// A state beyond the limits (they were lowered) is brought within them first. Limits that are no use
/// ([`rcc_core::axis::limits_are_valid`]), or a state or goal that is not finite, give a way without phases.
#[must_use]
pub fn plan(from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
    plan_to(from, &AxisState::at_rest(goal), limits).0
}

/// The same to a goal that is reached with a velocity and an acceleration, within the limits. After a stop it is reached
/// at rest.
#[must_use]
pub fn plan_to(from: &AxisState, to: &AxisState, limits: &MotionLimits) -> (Phases, GoalPlanKind) {
    if !(limits_are_valid(limits) && from.is_finite() && to.is_finite()) {
        return (Phases::default(), GoalPlanKind::AfterStop);
    }
    // From 0 on: a position far away would cost the digits of a short way.
    let beginning = from.position;
    let at = |state: &AxisState| AxisState {
        position: state.position - beginning,
        ..*state
    };
    let (from, to) = (&at(from), &at(to));
    if !to.is_finite() {
        return (Phases::default(), GoalPlanKind::AfterStop);
    }
    if from.rests() && to.rests() {
        let way = rest_to_rest(to.position, limits);
        return (Phases::of(&[&way]), GoalPlanKind::Fastest);
    }
    let found = fastest(from, to, limits).filter(|way| keeps(way, from, to, limits));
    // At the velocity limit rounding decides which profiles rsruckig sees, and its brake may lead back.
    let at_limit = most_velocity(from, limits) > limits.velocity * (1.0 - NEAR_LIMIT);
    let brake = at_limit.then(|| brake_first(from, to, limits)).flatten();
    let stop = stop_and_go(from, to.position, limits);
    let stop = to.rests().then_some(stop);
    let ways = [found, brake, stop].into_iter().flatten();
    // Without a way back, then the shortest; the first of those that differ by rounding.
    let better = |b: &Phases, a: &Phases| match (turns_back(b, from), turns_back(a, from)) {
        (false, true) => true,
        (true, false) => false,
        _ => b.duration_s() < a.duration_s() * (1.0 - TOLERANCE),
    };
    let best = ways.reduce(|a, b| if better(&b, &a) { b } else { a });
    match best {
        Some(way) if Some(way) != stop => (way, GoalPlanKind::Fastest),
        Some(way) => (way, GoalPlanKind::AfterStop),
        None => (
            stop_and_go(from, to.position, limits),
            GoalPlanKind::AfterStop,
        ),
    }
}

/// Whether it goes against the direction that it began in. Braking to a lower limit as fast as can be leaves an
/// acceleration that then leads beyond rest: fast, but nobody who lowers a speed wants the axis to go back.
fn turns_back(way: &Phases, from: &AxisState) -> bool {
    let direction = from.velocity.signum();
    let velocities = || way.extrema(*from).map(|state| state.velocity * direction);
    let (least, most) = velocities().fold((0.0_f64, 0.0_f64), |(least, most), velocity| {
        (least.min(velocity), most.max(velocity))
    });
    least < -TOLERANCE * most.max(-least)
}

/// Into the velocity limit and from there on; `None` if that keeps no limit.
fn brake_first(from: &AxisState, to: &AxisState, limits: &MotionLimits) -> Option<Phases> {
    let MotionLimits { velocity, jerk, .. } = *limits;
    let left = from.coasting(jerk);
    let cruise = if left.abs() > velocity * (1.0 - NEAR_LIMIT) {
        velocity.copysign(left)
    } else {
        left
    };
    let brake = to_velocity(from, cruise, limits);
    let mut at = Phases::of(&[&brake]).end(*from);
    (at.velocity, at.acceleration) = (cruise, 0.0);
    let rest = fastest(&at, to, limits)?;
    // At a limit there is nothing to brake: its first two phases are empty.
    let way = Phases::of(&[&brake, rest.0.get(2..)?]);
    keeps(&way, from, to, limits).then_some(way)
}

/// What rsruckig finds. Of a long way at constant speed it is asked for a short one, which is then drawn out again.
fn fastest(from: &AxisState, to: &AxisState, limits: &MotionLimits) -> Option<Phases> {
    let task = GoalProblem::of(from, to, limits);
    let ScaledProblem {
        from: (v0, a0),
        to: (vf, af),
        way,
        limits: [v, a, j],
    } = task.scaled;
    let mut profile = Profile::default();
    profile.set_boundary(0.0, v0, a0, way, vf, af);
    let Profile {
        brake,
        p,
        v: vs,
        a: accelerations,
        ..
    } = &mut profile;
    brake.get_position_brake_trajectory(v0, a0, v, -v, a, -a, j);
    let ([p0, ..], [v0, ..], [a0, ..]) = (p, vs, accelerations);
    brake.finalize(p0, v0, a0);
    let mut step = PositionThirdOrderStep1::new(*p0, *v0, *a0, way, vf, af, v, -v, a, -a, j);
    let mut block = Block::default();
    if !step.get_profile(&profile, &mut block) {
        return None;
    }
    let Profile {
        brake, t, j: jerks, ..
    } = block.p_min;
    let mut phases = Phases::default();
    let durations = brake.t.into_iter().chain(t);
    let jerks = brake.j.into_iter().chain(jerks);
    for (place, (duration, jerk)) in phases.0.iter_mut().zip(durations.zip(jerks)) {
        *place = (duration * task.unit_s, limits.jerk * (jerk / j));
    }
    if let Some((duration_s, _)) = phases.0.get_mut(CRUISE) {
        *duration_s += task.cut_s;
    }
    Some(phases)
}

/// The phase at constant speed, after two to brake and three to get there.
const CRUISE: usize = 5;

/// A task in units in which it takes about a second and goes about as far as 1.
struct GoalProblem {
    scaled: ScaledProblem,
    /// The unit of time, s; a power of two, so that nothing is rounded.
    unit_s: f64,
    /// Time at the greatest speed that was cut out of the way, s.
    cut_s: f64,
}

struct ScaledProblem {
    /// Velocity and acceleration.
    from: (f64, f64),
    /// The same at the goal.
    to: (f64, f64),
    way: f64,
    limits: [f64; 3],
}

impl GoalProblem {
    fn of(from: &AxisState, to: &AxisState, limits: &MotionLimits) -> GoalProblem {
        let &MotionLimits {
            velocity,
            acceleration,
            jerk,
        } = limits;
        let stop = to_velocity(from, 0.0, limits);
        let rest = Phases::of(&[&stop]).end(*from);
        let go = rest_to_rest(to.position - rest.position, limits);
        let [_, _, _, (cruise_s, _), ..] = go;
        let [stop_s, go_s] =
            [&stop[..], &go[..]].map(|way| way.iter().map(|(t, _)| t).sum::<f64>());
        // What is left after the cut has room for every other phase of the fastest way.
        let cut_s = (cruise_s - 4.0 * (stop_s + go_s - cruise_s)).max(0.0);
        let way = to.position - from.position;
        let cut = (velocity * cut_s).copysign(to.position - rest.position);
        let way = way - cut;
        // Not a power that a sum of all could miss: lengths within a factor of the stop and of what is left.
        let length = way
            .abs()
            .max((rest.position - from.position).abs())
            .max((to.position - rest.position - cut).abs());
        let (unit_s, unit) = (power_of_two(stop_s + go_s - cut_s), power_of_two(length));
        let of_velocity = |v: f64| v * unit_s / unit;
        let of_acceleration = |a: f64| of_velocity(a) * unit_s;
        // No motion between such velocities reaches more than this; a greater limit would only cost digits.
        let reachable = 2.0 * (most_velocity(from, limits) * jerk).sqrt();
        let acceleration = acceleration.min(
            reachable
                .max(from.acceleration.abs())
                .max(to.acceleration.abs()),
        );
        GoalProblem {
            scaled: ScaledProblem {
                from: (
                    of_velocity(from.velocity),
                    of_acceleration(from.acceleration),
                ),
                to: (of_velocity(to.velocity), of_acceleration(to.acceleration)),
                way: way / unit,
                limits: [
                    of_velocity(velocity),
                    of_acceleration(acceleration),
                    of_acceleration(jerk) * unit_s,
                ],
            },
            unit_s,
            cut_s,
        }
    }
}

/// The limit, or what the state makes inevitable.
fn most_velocity(from: &AxisState, limits: &MotionLimits) -> f64 {
    let inevitable = from.velocity.abs().max(from.coasting(limits.jerk).abs());
    limits.velocity.max(inevitable)
}

/// The greatest power of two that is not greater; 1 for what has none.
fn power_of_two(value: f64) -> f64 {
    // The exponent alone: 52 bits of fraction make 1.
    let power = f64::from_bits(value.abs().to_bits() & 0x7ff0_0000_0000_0000);
    if power > 1e-200 && power < 1e200 {
        power
    } else {
        1.0
    }
}

/// Whether a way ends at its goal and keeps the limits, but for what its beginning makes inevitable.
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
    let end = way.end(*from);
    let way_m = (to.position - from.position).abs() + most_velocity * way.duration_s();
    steps
        && corners
        && (end.position - to.position).abs() <= TOLERANCE * way_m
        && (end.velocity - to.velocity).abs() <= TOLERANCE * most_velocity
        && (end.acceleration - to.acceleration).abs() <= TOLERANCE * most_acceleration
}

#[cfg(test)]
mod tests;
