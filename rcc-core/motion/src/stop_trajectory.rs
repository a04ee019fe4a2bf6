//! The way of up to eight joints from motion to rest when no command comes any more, jerk-limited and soft.
//! No allocation; stepped by the drivers, and anywhere else where set-points end.

use rcc_core::message::JOINTS_MAX;
use thiserror::Error;

use crate::jerk_profile::{AccelerationLimits, JerkProfile, KinematicState, VelocityChange};

/// Halvings in the search for a joint's limits: 2⁻³⁰ of the way between the gentlest and its own is close enough.
const HALVINGS: usize = 30;

/// Durations or speeds that differ by less than this part are the same.
const SAME: f64 = 1e-9;

/// What joints may use to come to rest; elements beyond `joints` are not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopLimits {
    /// Largest |velocity|, rad/s (> 0).
    pub velocity_max: [f64; JOINTS_MAX],
    /// Largest |acceleration|, rad/s² (> 0).
    pub acceleration_max: [f64; JOINTS_MAX],
    /// Largest |jerk|, rad/s³ (> 0).
    pub jerk_max: [f64; JOINTS_MAX],
    /// Number of joints, at most [`JOINTS_MAX`].
    pub joints: usize,
}

/// Why limits are refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum StopLimitsError {
    /// More joints than a device may have.
    #[error("{joints} joints: at most {JOINTS_MAX}")]
    Joints {
        /// What was given.
        joints: usize,
    },
    /// A limit is zero, negative, NaN or infinite.
    #[error("joint {}: {limit} limit {value}: give a finite number greater than 0", joint + 1)]
    Limit {
        /// The joint, counted from 0.
        joint: usize,
        /// `velocity`, `acceleration` or `jerk`.
        limit: &'static str,
        /// What was given.
        value: f64,
    },
    /// The cycle time is zero, negative, NaN or infinite.
    #[error("cycle time {dt_s} s: give a finite number greater than 0")]
    CycleTime {
        /// What was given, s.
        dt_s: f64,
    },
}

/// Why a way to rest cannot begin; the one before goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum StopFault {
    /// Position, velocity or acceleration of this joint (counted from 0) is missing, NaN or infinite.
    #[error("joint {}: position, velocity and acceleration must be finite numbers", joint + 1)]
    NotFinite {
        /// The joint, counted from 0.
        joint: usize,
    },
}

/// Brings joints to rest, one cycle a step, and holds them there.
///
/// Every joint keeps its own acceleration and jerk limit, and all come to rest together as far as that makes nothing
/// slower. If the acceleration points along the velocity (a straight line in joint space, or no acceleration) the joints
/// stay on that line exactly, unless one would exceed its velocity limit there; otherwise they stay next to it.
///
/// A joint gets faster only while it lets go of an acceleration that it began with: never beyond its velocity limit,
/// unless its jerk limit leaves no choice (a²/2J above the velocity at the beginning).
///
/// From a velocity v without acceleration a joint moves on by v·T/2, where T = v/A + A/J (2·√(v/J) if A is not reached)
/// of the slowest joint; with an acceleration, by at most its greatest speed times the duration. Position limits are not
/// looked at.
#[derive(Debug, Clone)]
pub struct StopTrajectory {
    limits: StopLimits,
    dt_s: f64,
    profiles: [JerkProfile; JOINTS_MAX],
    /// Cycles since `begin`.
    cycle: u64,
    position: [f64; JOINTS_MAX],
    resting: bool,
}

impl StopTrajectory {
    /// For a device with these limits whose set-points are `dt_s` (s) apart. Until [`StopTrajectory::begin`] it rests nowhere:
    /// positions are NaN.
    ///
    /// # Errors
    /// A limit that is not a finite number greater than 0.
    pub fn new(limits: StopLimits, dt_s: f64) -> Result<Self, StopLimitsError> {
        if limits.joints > JOINTS_MAX {
            return Err(StopLimitsError::Joints {
                joints: limits.joints,
            });
        }
        let rows = [
            ("velocity", limits.velocity_max),
            ("acceleration", limits.acceleration_max),
            ("jerk", limits.jerk_max),
        ];
        for (limit, values) in rows {
            for (joint, value) in values.into_iter().take(limits.joints).enumerate() {
                if !(value.is_finite() && value > 0.0) {
                    return Err(StopLimitsError::Limit {
                        joint,
                        limit,
                        value,
                    });
                }
            }
        }
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(StopLimitsError::CycleTime { dt_s });
        }
        let profiles = [JerkProfile::default(); JOINTS_MAX];
        Ok(Self {
            limits,
            dt_s,
            profiles,
            cycle: 0,
            position: [f64::NAN; JOINTS_MAX],
            resting: true,
        })
    }

    /// Begins at the last set-point (rad, rad/s, rad/s², one element a joint); the next step is one cycle after it.
    ///
    /// # Errors
    /// An element that is missing or not finite; nothing changes then.
    pub fn begin(
        &mut self,
        position: &[f64],
        velocity: &[f64],
        acceleration: &[f64],
    ) -> Result<(), StopFault> {
        let mut starts = [KinematicState::default(); JOINTS_MAX];
        for (joint, start) in starts.iter_mut().enumerate().take(self.limits.joints) {
            let element = |values: &[f64]| {
                values
                    .get(joint)
                    .copied()
                    .filter(|x| x.is_finite())
                    .ok_or(StopFault::NotFinite { joint })
            };
            let (position, velocity) = (element(position)?, element(velocity)?);
            *start = KinematicState {
                position,
                velocity,
                acceleration: element(acceleration)?,
            };
        }
        self.profiles = self.plan(&starts);
        self.position = starts.map(|start| start.position);
        self.cycle = 1;
        self.resting = false;
        Ok(())
    }

    /// The set-points of this cycle (rad; 0 beyond the device's joints), and whether all joints rest there.
    pub fn step(&mut self) -> ([f64; JOINTS_MAX], bool) {
        if !self.resting {
            #[allow(clippy::cast_precision_loss)] // 2^53 cycles are 285,000 years at 1 kHz.
            let t_s = self.cycle as f64 * self.dt_s;
            self.cycle = self.cycle.saturating_add(1);
            self.resting = true;
            for (position, profile) in self.position.iter_mut().zip(&self.profiles) {
                let state = profile.at(t_s);
                self.resting &= state.is_none();
                *position = state.map_or(profile.end_position(), |state| state.position);
            }
        }
        (self.position, self.resting)
    }

    /// Whether nothing moves: it never began, or the last step was the last one.
    #[must_use]
    pub fn is_resting(&self) -> bool {
        self.resting
    }

    fn plan(&self, starts: &[KinematicState; JOINTS_MAX]) -> [JerkProfile; JOINTS_MAX] {
        let StopLimits {
            velocity_max,
            acceleration_max,
            jerk_max,
            joints,
        } = self.limits;
        let limits = velocity_max
            .into_iter()
            .zip(acceleration_max)
            .zip(jerk_max)
            .take(joints);
        let rows = || {
            let rows = starts.iter().zip(limits.clone());
            rows.map(|(start, ((velocity, a), jerk))| {
                (*start, velocity, AxisStopLimits { a, jerk })
            })
        };

        let line = VelocityLine::through(rows().map(|(start, _, own)| (start, own)));
        let slowest = rows()
            .map(|(start, _, own)| own.stop(start).duration_s())
            .fold(0.0, f64::max);
        let together_s = slowest.max(line.duration_s());

        let mut profiles = [JerkProfile::default(); JOINTS_MAX];
        for (profile, (start, velocity_max, own)) in profiles.iter_mut().zip(rows()) {
            let bounds = StopBounds {
                duration_s: together_s,
                speed: velocity_max.max(own.peak_speed(start)),
            };
            *profile = line.limits(start, own, bounds).stop(start).profile(start);
        }
        profiles
    }
}

/// The limits of one joint.
#[derive(Debug, Clone, Copy)]
struct AxisStopLimits {
    a: f64,
    jerk: f64,
}

impl AxisStopLimits {
    fn stop(self, start: KinematicState) -> VelocityChange {
        let limits = AccelerationLimits {
            acceleration: self.a,
            jerk: self.jerk,
        };
        VelocityChange::new(start.velocity, start.acceleration, limits)
    }

    /// The greatest speed of the stop: at its beginning, or where the acceleration has been let go.
    fn peak_speed(
        self,
        KinematicState {
            velocity,
            acceleration,
            ..
        }: KinematicState,
    ) -> f64 {
        velocity
            .abs()
            .max((velocity + acceleration * acceleration.abs() / (2.0 * self.jerk)).abs())
    }

    /// `part` = 0: these, 1: `other`.
    fn towards(self, other: Self, part: f64) -> Self {
        let between = |from: f64, to: f64| from + part * (to - from);
        Self {
            a: between(self.a, other.a),
            jerk: between(self.jerk, other.jerk),
        }
    }
}

/// The straight line along the velocity of all joints, on which one parameter with a speed of 1 comes to rest.
#[derive(Debug, Clone, Copy)]
struct VelocityLine {
    /// The parameter's limits, such that no joint exceeds its own; infinite if nothing moves.
    limits: AxisStopLimits,
    /// The part of the acceleration that points along the line, as the parameter's.
    acceleration: f64,
}

impl VelocityLine {
    fn through(rows: impl Iterator<Item = (KinematicState, AxisStopLimits)>) -> Self {
        let mut limits = AxisStopLimits {
            a: f64::INFINITY,
            jerk: f64::INFINITY,
        };
        let (mut along, mut speed_squared) = (0.0, 0.0);
        for (
            KinematicState {
                velocity,
                acceleration,
                ..
            },
            own,
        ) in rows.filter(|(start, _)| start.velocity != 0.0)
        {
            limits.a = limits.a.min(own.a / velocity.abs());
            limits.jerk = limits.jerk.min(own.jerk / velocity.abs());
            along += acceleration * velocity;
            speed_squared += velocity * velocity;
        }
        // More than the limit points off the line; as a part of it, it would take very long.
        let acceleration = if speed_squared > 0.0 {
            (along / speed_squared).max(-limits.a).min(limits.a)
        } else {
            0.0
        };
        Self {
            limits,
            acceleration,
        }
    }

    /// How long the stop on the line takes, s; 0 if nothing moves.
    fn duration_s(&self) -> f64 {
        if self.limits.a.is_finite() && self.limits.jerk.is_finite() {
            self.limits
                .stop(KinematicState {
                    velocity: 1.0,
                    acceleration: self.acceleration,
                    position: 0.0,
                })
                .duration_s()
        } else {
            0.0
        }
    }

    /// The limits that a joint stops with: in the ratio of the velocities, in which joints stay on the line, or as much
    /// of its own as it needs to stay within the bounds. With all of its own it does.
    fn limits(
        &self,
        start: KinematicState,
        own: AxisStopLimits,
        bounds: StopBounds,
    ) -> AxisStopLimits {
        let share = |line: f64, own: f64| (line * start.velocity.abs()).min(own);
        let gentle = AxisStopLimits {
            a: share(self.limits.a, own.a),
            jerk: share(self.limits.jerk, own.jerk),
        };
        let keeps = |limits: AxisStopLimits| {
            limits.stop(start).duration_s() <= bounds.duration_s * (1.0 + SAME)
                && limits.peak_speed(start) <= bounds.speed * (1.0 + SAME)
        };
        if keeps(gentle) {
            return gentle;
        }
        // A harder stop is never slower and never faster on its way, so one part divides the others.
        let (mut little, mut enough) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (little + enough);
            *(if keeps(gentle.towards(own, middle)) {
                &mut enough
            } else {
                &mut little
            }) = middle;
        }
        gentle.towards(own, enough)
    }
}

/// What the stop of one joint may not exceed.
#[derive(Debug, Clone, Copy)]
struct StopBounds {
    duration_s: f64,
    /// The velocity limit, or what the joint cannot avoid, rad/s.
    speed: f64,
}

#[cfg(test)]
mod tests;
