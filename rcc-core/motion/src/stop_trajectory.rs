//! Stop trajectory: brings up to eight joints to rest, jerk-limited, when commands stop arriving. Does not allocate;
//! stepped by drivers and simulators.

use rcc_core::axis::AxisState;
use rcc_core::message::JOINTS_MAX;
use thiserror::Error;

use crate::jerk_profile::{AccelerationLimits, JerkProfile};

/// Bisections in the search for a joint's limits: 2⁻³⁰ of the range between the gentlest and its own limits is close
/// enough.
const HALVINGS: usize = 30;

/// Relative difference below which durations or speeds count as equal.
const SAME: f64 = 1e-9;

/// Limits that joints may use to come to rest; elements beyond `joints` are ignored.
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
        /// The given value.
        joints: usize,
    },
    /// A limit is zero, negative, NaN or infinite.
    #[error("joint {}: {limit} limit {value}: give a finite number greater than 0", joint + 1)]
    Limit {
        /// The joint, counted from 0.
        joint: usize,
        /// `velocity`, `acceleration` or `jerk`.
        limit: &'static str,
        /// The given value.
        value: f64,
    },
    /// The cycle time is zero, negative, NaN or infinite.
    #[error("cycle time {dt_s} s: give a finite number greater than 0")]
    CycleTime {
        /// The given value, s.
        dt_s: f64,
    },
}

/// Why a stop trajectory cannot begin; the previous one continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum StopFault {
    /// Position, velocity or acceleration of this joint (counted from 0) is missing, NaN or infinite.
    #[error("joint {}: position, velocity and acceleration must be finite numbers", joint + 1)]
    NotFinite {
        /// The joint, counted from 0.
        joint: usize,
    },
}

/// Brings joints to rest, one cycle per step, and holds them there.
///
/// Every joint keeps its own acceleration and jerk limit. All joints come to rest together, as far as that does not
/// make the stop longer. If acceleration and velocity are parallel in joint space (a straight line, or no
/// acceleration), the joints stay exactly on that line unless one would exceed its velocity limit; otherwise they stay
/// close to it.
///
/// A joint gets faster only while an initial acceleration is reduced to 0: never beyond its velocity limit, unless the
/// jerk limit makes it inevitable (a²/2J above the initial velocity).
///
/// From a velocity v without acceleration a joint moves by v·T/2, where T = v/A + A/J (2·√(v/J) if A is not reached) of
/// the slowest joint; with an acceleration, by at most its greatest speed times the duration. Position limits are not
/// checked.
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
    /// A stop trajectory for a device with these limits whose set-points are `dt_s` (s) apart. Until
    /// [`StopTrajectory::begin`] is called, positions are NaN.
    ///
    /// # Errors
    /// Returns [`StopLimitsError`] for more than [`JOINTS_MAX`] joints, and if a limit or `dt_s` is not a finite number
    /// greater than 0.
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

    /// Begins at the last set-point (rad, rad/s, rad/s², one element per joint); the next step is one cycle later.
    ///
    /// # Errors
    /// Returns [`StopFault::NotFinite`] if an element is missing or not finite; nothing changes then.
    pub fn begin(
        &mut self,
        position: &[f64],
        velocity: &[f64],
        acceleration: &[f64],
    ) -> Result<(), StopFault> {
        let mut starts = [AxisState::default(); JOINTS_MAX];
        for (joint, start) in starts.iter_mut().enumerate().take(self.limits.joints) {
            let element = |values: &[f64]| {
                values
                    .get(joint)
                    .copied()
                    .filter(|x| x.is_finite())
                    .ok_or(StopFault::NotFinite { joint })
            };
            let (position, velocity) = (element(position)?, element(velocity)?);
            *start = AxisState {
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

    /// Advances by one cycle. Returns the set-points (rad; 0 beyond the device's joints) and whether all joints are at
    /// rest.
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

    /// Returns true if nothing moves: the stop has not begun, or has ended.
    #[must_use]
    pub fn is_resting(&self) -> bool {
        self.resting
    }

    fn plan(&self, starts: &[AxisState; JOINTS_MAX]) -> [JerkProfile; JOINTS_MAX] {
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
            rows.map(|(start, ((velocity, acceleration), jerk))| {
                (*start, velocity, AccelerationLimits { acceleration, jerk })
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

impl AccelerationLimits {
    /// Greatest speed during the stop: at its beginning, or where the acceleration has been reduced to 0.
    fn peak_speed(self, start: AxisState) -> f64 {
        start.velocity.abs().max(start.coasting(self.jerk).abs())
    }

    /// Interpolates between these limits (`part` = 0) and `other` (`part` = 1).
    fn towards(self, other: Self, part: f64) -> Self {
        let between = |from: f64, to: f64| from + part * (to - from);
        Self {
            acceleration: between(self.acceleration, other.acceleration),
            jerk: between(self.jerk, other.jerk),
        }
    }
}

/// The straight line along the velocity of all joints in joint space. One parameter with an initial speed of 1 comes to
/// rest on it.
#[derive(Debug, Clone, Copy)]
struct VelocityLine {
    /// Limits of the parameter such that no joint exceeds its own; infinite if nothing moves.
    limits: AccelerationLimits,
    /// Component of the acceleration along the line, in units of the parameter.
    acceleration: f64,
}

impl VelocityLine {
    fn through(rows: impl Iterator<Item = (AxisState, AccelerationLimits)>) -> Self {
        let mut limits = AccelerationLimits {
            acceleration: f64::INFINITY,
            jerk: f64::INFINITY,
        };
        let (mut along, mut speed_squared) = (0.0, 0.0);
        for (
            AxisState {
                velocity,
                acceleration,
                ..
            },
            own,
        ) in rows.filter(|(start, _)| start.velocity != 0.0)
        {
            limits.acceleration = limits.acceleration.min(own.acceleration / velocity.abs());
            limits.jerk = limits.jerk.min(own.jerk / velocity.abs());
            along += acceleration * velocity;
            speed_squared += velocity * velocity;
        }
        // An acceleration beyond the limit points mostly off the line; taken as a component of the line it would make
        // the stop very long.
        let acceleration = if speed_squared > 0.0 {
            (along / speed_squared)
                .max(-limits.acceleration)
                .min(limits.acceleration)
        } else {
            0.0
        };
        Self {
            limits,
            acceleration,
        }
    }

    /// Duration of the stop on the line, s; 0 if nothing moves.
    fn duration_s(&self) -> f64 {
        if self.limits.acceleration.is_finite() && self.limits.jerk.is_finite() {
            self.limits
                .stop(AxisState {
                    velocity: 1.0,
                    acceleration: self.acceleration,
                    position: 0.0,
                })
                .duration_s()
        } else {
            0.0
        }
    }

    /// The limits with which a joint stops: proportional to the velocities, so that joints stay on the line, or as much
    /// of the joint's own limits as it needs to stay within the bounds. With its own limits it always does.
    fn limits(
        &self,
        start: AxisState,
        own: AccelerationLimits,
        bounds: StopBounds,
    ) -> AccelerationLimits {
        let share = |line: f64, own: f64| (line * start.velocity.abs()).min(own);
        let gentle = AccelerationLimits {
            acceleration: share(self.limits.acceleration, own.acceleration),
            jerk: share(self.limits.jerk, own.jerk),
        };
        let keeps = |limits: AccelerationLimits| {
            limits.stop(start).duration_s() <= bounds.duration_s * (1.0 + SAME)
                && limits.peak_speed(start) <= bounds.speed * (1.0 + SAME)
        };
        if keeps(gentle) {
            return gentle;
        }
        // A harder stop never takes longer and is never faster on the way, so bisection applies.
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

/// Bounds for the stop of one joint.
#[derive(Debug, Clone, Copy)]
struct StopBounds {
    duration_s: f64,
    /// Velocity limit, or the speed that the joint cannot avoid, rad/s.
    speed: f64,
}

#[cfg(test)]
mod tests;
