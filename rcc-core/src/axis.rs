//! Motion of one axis to a goal that may change in any cycle: phases of constant jerk, and the follower that steps
//! along them. Pure arithmetic on a fixed number of words, which are stored in a net's arena; run by the real-time
//! thread.
//!
//! Everything in this module has a closed form and cannot fail: the stop, the rest-to-rest motion, and one after the
//! other. The time-optimal motion from an arbitrary state is computed by a planner
//! ([`crate::path::Motions::plan_axis`]).

use serde::{Deserialize, Serialize};

mod follower;
mod slots;
mod together;

pub use follower::{AXIS_WORDS, AxisFollower};
pub use slots::{AxisSlot, axes, continued, is_new, rest_at, share_of, step_axis};
pub use together::{AxisTask, plan_together};

/// Maximum number of phases of a motion: two or three to brake into the limits, seven to the goal.
pub const PHASES_MAX: usize = 10;

/// Limits of velocity, acceleration and jerk along a path or axis, in its unit per s, s² and s³ (each > 0; infinite:
/// limited only by the joints).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionLimits {
    /// Per second. A finite value for a leg is guaranteed: the leg is travelled at this velocity, or refused.
    pub velocity: f64,
    /// Per second squared.
    pub acceleration: f64,
    /// Per second cubed.
    pub jerk: f64,
}

impl MotionLimits {
    /// No limits.
    pub const NONE: MotionLimits = MotionLimits {
        velocity: f64::INFINITY,
        acceleration: f64::INFINITY,
        jerk: f64::INFINITY,
    };

    /// Creates limits from velocity, acceleration and jerk; null (NaN) means unlimited.
    #[must_use]
    pub fn of(values: [f64; 3]) -> MotionLimits {
        let [velocity, acceleration, jerk] =
            values.map(|value| if value.is_nan() { f64::INFINITY } else { value });
        MotionLimits {
            velocity,
            acceleration,
            jerk,
        }
    }
}

/// Position, velocity and acceleration of an axis, in its unit, per s and per s².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxisState {
    /// Position.
    pub position: f64,
    /// Velocity, per s.
    pub velocity: f64,
    /// Acceleration, per s².
    pub acceleration: f64,
}

impl AxisState {
    /// Returns the state at rest at `position`.
    #[must_use]
    pub const fn at_rest(position: f64) -> AxisState {
        AxisState {
            position,
            velocity: 0.0,
            acceleration: 0.0,
        }
    }

    /// Returns true if velocity and acceleration are 0.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.velocity == 0.0 && self.acceleration == 0.0
    }

    /// Returns true if all three values are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite() && self.acceleration.is_finite()
    }

    /// Returns the state `t_s` later under constant jerk.
    #[must_use]
    pub fn after(self, t_s: f64, jerk: f64) -> AxisState {
        let AxisState {
            position,
            velocity,
            acceleration,
        } = self;
        AxisState {
            position: position + t_s * (velocity + t_s * (acceleration / 2.0 + t_s * jerk / 6.0)),
            velocity: velocity + t_s * (acceleration + t_s * jerk / 2.0),
            acceleration: acceleration + t_s * jerk,
        }
    }

    /// Returns the velocity that remains when the acceleration is reduced to 0 with `jerk`: the velocity that the axis
    /// inevitably reaches.
    #[must_use]
    pub fn coasting(&self, jerk: f64) -> f64 {
        self.velocity + self.acceleration * self.acceleration.abs() / (2.0 * jerk)
    }
}

/// Returns true if an axis can be moved with these limits: all are finite and above 0.
#[must_use]
pub fn limits_are_valid(limits: &MotionLimits) -> bool {
    let &MotionLimits {
        velocity,
        acceleration,
        jerk,
    } = limits;
    let all = [velocity, acceleration, jerk];
    all.iter().all(|limit| limit.is_finite() && *limit > 0.0)
}

/// A motion as consecutive phases of (duration s, jerk).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Phases(pub [(f64, f64); PHASES_MAX]);

impl Phases {
    /// Concatenates the parts in order; phases beyond [`PHASES_MAX`] are dropped.
    #[must_use]
    pub fn of(parts: &[&[(f64, f64)]]) -> Phases {
        let mut phases = Phases::default();
        let steps = parts.iter().flat_map(|part| part.iter());
        for (place, step) in phases.0.iter_mut().zip(steps) {
            *place = *step;
        }
        phases
    }

    /// Returns the duration, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.0.iter().map(|(duration_s, _)| duration_s).sum()
    }

    /// Returns the states at which velocity and acceleration have their extrema: the phase boundaries, and the zero
    /// crossings of the acceleration within phases.
    pub fn extrema(&self, start: AxisState) -> impl Iterator<Item = AxisState> + '_ {
        let pairs = self.0.iter().scan(start, |state, (duration_s, jerk)| {
            let (begin, end) = (*state, state.after(*duration_s, *jerk));
            *state = end;
            let through = begin.acceleration * end.acceleration < 0.0;
            let extremum = if through {
                begin.after(-begin.acceleration / jerk, *jerk)
            } else {
                begin
            };
            Some([extremum, end])
        });
        core::iter::once(start).chain(pairs.flatten())
    }

    /// Returns the state at the end of the motion that starts in `start`.
    #[must_use]
    pub fn end(&self, start: AxisState) -> AxisState {
        let steps = self.0.iter();
        steps.fold(start, |state, (duration_s, jerk)| {
            state.after(*duration_s, *jerk)
        })
    }
}

/// Returns the fastest change of velocity to `velocity` at zero acceleration: jerk −J, 0, +J or the opposite. An
/// acceleration beyond its limit is reduced at the jerk limit and never exceeded further.
#[must_use]
pub fn to_velocity(from: &AxisState, velocity: f64, limits: &MotionLimits) -> [(f64, f64); 3] {
    let &MotionLimits {
        acceleration: most,
        jerk,
        ..
    } = limits;
    let direction = if from.coasting(jerk) < velocity {
        -1.0
    } else {
        1.0
    };
    let (v, a) = (
        direction * (from.velocity - velocity),
        direction * from.acceleration,
    );
    // Without a phase at the acceleration limit the peak satisfies v + a²/2J = peak²/J; apart from rounding it is at
    // least −a.
    let free = higher(libm::sqrt(higher(jerk * v + a * a / 2.0, 0.0)), -a);
    let peak = lower(free, higher(most, -a));
    let hold_s = if peak < free {
        (v + a * a / (2.0 * jerk) - peak * peak / jerk) / peak
    } else {
        0.0
    };
    let jerk = direction * jerk;
    let ramp_s = |change: f64| change / jerk.abs();
    [
        (ramp_s(a + peak), -jerk),
        (hold_s, 0.0),
        (ramp_s(peak), jerk),
    ]
}

/// Returns the fastest rest-to-rest motion over `distance`: Biagiotti and Melchiorri, Trajectory Planning for Automatic
/// Machines and Robots, 2008, 3.4 (double S with zero velocities at both ends).
#[must_use]
pub fn rest_to_rest(distance: f64, limits: &MotionLimits) -> [(f64, f64); 7] {
    let &MotionLimits {
        velocity: v,
        acceleration: a,
        jerk: j,
    } = limits;
    let length = distance.abs();
    // Acceleration to the velocity limit: with or without a phase at the acceleration limit.
    let (mut ramp_s, mut hold_s) = if v * j > a * a {
        (a / j, v / a - a / j)
    } else {
        (libm::sqrt(v / j), 0.0)
    };
    let mut cruise_s = length / v - (2.0 * ramp_s + hold_s);
    if cruise_s < 0.0 {
        cruise_s = 0.0;
        ramp_s = a / j;
        hold_s = (libm::sqrt(ramp_s * ramp_s + 4.0 * length / a) - 3.0 * ramp_s) / 2.0;
        if hold_s < 0.0 {
            (ramp_s, hold_s) = (libm::cbrt(length / (2.0 * j)), 0.0);
        }
    }
    let jerk = if distance < 0.0 { -j } else { j };
    [
        (ramp_s, jerk),
        (hold_s, 0.0),
        (ramp_s, -jerk),
        (cruise_s, 0.0),
        (ramp_s, -jerk),
        (hold_s, 0.0),
        (ramp_s, jerk),
    ]
}

/// Returns a motion that first stops and then moves to `goal`: not the fastest motion, but one that always exists.
#[must_use]
pub fn stop_and_go(from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
    let stop = to_velocity(from, 0.0, limits);
    let rest = Phases::of(&[&stop]).end(*from);
    Phases::of(&[&stop, &rest_to_rest(goal - rest.position, limits)])
}

fn higher(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

fn lower(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests;
