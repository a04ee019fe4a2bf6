//! The problem of one axis in the units in which rsruckig solves it. Run by the real-time thread.

use rcc_core::axis::{AxisState, Phases, rest_to_rest, to_velocity};
use rcc_core::path::MotionLimits;
use rsruckig::prelude::Profile;

use super::most_velocity;

/// Index of the phase at constant speed: it follows two phases of braking and three of acceleration.
const CRUISE: usize = 5;

/// A problem scaled to units in which the motion takes about a second and covers a distance of about 1.
pub(super) struct GoalProblem {
    pub(super) scaled: ScaledProblem,
    /// Unit of time, s; a power of two, so that scaling does not round.
    pub(super) unit_s: f64,
    /// Time at full speed that was cut out of the motion, s.
    cut_s: f64,
}

pub(super) struct ScaledProblem {
    /// Initial velocity and acceleration.
    from: (f64, f64),
    /// Velocity and acceleration at the goal.
    pub(super) to: (f64, f64),
    pub(super) way: f64,
    pub(super) limits: [f64; 3],
}

impl GoalProblem {
    /// The phases of a scaled profile: brake and motion, with the time that was cut out.
    pub(super) fn phases(&self, profile: &Profile, jerk_limit: f64) -> Phases {
        let [.., scaled_limit] = self.scaled.limits;
        let mut phases = Phases::default();
        let durations = profile.brake.t.into_iter().chain(profile.t);
        let jerks = profile.brake.j.into_iter().chain(profile.j);
        for (place, (duration, jerk)) in phases.0.iter_mut().zip(durations.zip(jerks)) {
            *place = (duration * self.unit_s, jerk_limit * (jerk / scaled_limit));
        }
        if let Some((duration_s, _)) = phases.0.get_mut(CRUISE) {
            *duration_s += self.cut_s;
        }
        phases
    }

    /// A scaled profile that begins with the brake into the limits.
    pub(super) fn braked(&self) -> Profile {
        let ScaledProblem {
            from: (v0, a0),
            to: (vf, af),
            way,
            limits: [v, a, j],
        } = self.scaled;
        let mut profile = Profile::default();
        profile.set_boundary(0.0, v0, a0, way, vf, af);
        let brake = &mut profile.brake;
        brake.get_position_brake_trajectory(v0, a0, v, -v, a, -a, j);
        let ([p0, ..], [v0, ..], [a0, ..]) = (&mut profile.p, &mut profile.v, &mut profile.a);
        brake.finalize(p0, v0, a0);
        profile
    }

    /// The problem of the soonest motion.
    pub(super) fn of(from: &AxisState, to: &AxisState, limits: &MotionLimits) -> GoalProblem {
        let velocity = limits.velocity;
        let stop = to_velocity(from, 0.0, limits);
        let rest = Phases::of(&[&stop]).end(*from);
        let go = rest_to_rest(to.position - rest.position, limits);
        let [_, _, _, (cruise_s, _), ..] = go;
        let [stop_s, go_s] =
            [&stop[..], &go[..]].map(|way| way.iter().map(|(t, _)| t).sum::<f64>());
        // The motion that remains after the cut is long enough for every other phase of the time-optimal motion.
        let cut_s = (cruise_s - 4.0 * (stop_s + go_s - cruise_s)).max(0.0);
        let way = to.position - from.position;
        let cut = (velocity * cut_s).copysign(to.position - rest.position);
        let way = way - cut;
        // Not the power of two of a sum, in which terms could cancel: the lengths of the stop and of the remaining
        // distance each count.
        let length = way
            .abs()
            .max((rest.position - from.position).abs())
            .max((to.position - rest.position - cut).abs());
        let times_s = [stop_s + go_s - cut_s, cut_s];
        GoalProblem::scaled((from, to), limits, (way, length), times_s)
    }

    /// The problem of a motion that takes `duration_s` (s).
    pub(super) fn lasting(
        from: &AxisState,
        to: &AxisState,
        limits: &MotionLimits,
        duration_s: f64,
    ) -> Self {
        let way = to.position - from.position;
        let length = way.abs().max(from.velocity.abs() * duration_s);
        GoalProblem::scaled((from, to), limits, (way, length), [duration_s, 0.0])
    }

    /// A distance `way`, scaled by the greatest length in it and by the duration of the motion; with the time that was
    /// cut out, s.
    fn scaled(
        (from, to): (&AxisState, &AxisState),
        limits: &MotionLimits,
        (way, length): (f64, f64),
        [duration_s, cut_s]: [f64; 2],
    ) -> GoalProblem {
        let &MotionLimits {
            velocity,
            acceleration,
            jerk,
        } = limits;
        let (unit_s, unit) = (power_of_two(duration_s), power_of_two(length));
        let of_velocity = |v: f64| v * unit_s / unit;
        let of_acceleration = |a: f64| of_velocity(a) * unit_s;
        // No motion between these velocities reaches a greater acceleration; a greater limit would only cost precision.
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

/// Position, velocity and acceleration of a profile after its brake.
pub(super) fn start(profile: &Profile) -> [f64; 3] {
    let ([p0, ..], [v0, ..], [a0, ..]) = (profile.p, profile.v, profile.a);
    [p0, v0, a0]
}

/// The greatest power of two that is not greater than |value|; 1 if the value is 0, extreme or not finite.
fn power_of_two(value: f64) -> f64 {
    // Keep the exponent only: with a fraction of 0 the significand is 1.
    let power = f64::from_bits(value.abs().to_bits() & 0x7ff0_0000_0000_0000);
    if power > 1e-200 && power < 1e200 {
        power
    } else {
        1.0
    }
}
