//! The last check of a set-point of an arm, each cycle, before it leaves for the robot.
//! Pure arithmetic over the last two set-points and logical time; run by the real-time thread and by the drivers.

use core::fmt;

use crate::impedance::{AXES, Impedance, ImpedanceLimits, Strategy};
use crate::kinematics::Arm;
use crate::message::JOINTS_MAX;
use crate::workspace::{Leaves, Stay, Workspace};

mod impedance;

/// A limit may be exceeded by this part of itself: set-points that use a limit fully are rounded.
const RELATIVE_TOLERANCE: f64 = 1e-9;

/// Rounding of positions shows in their differences; but it excuses no more than this part of a limit.
const ROUNDING_MAX: f64 = 1e-3;

/// A step that would need more than this many times the velocity limit is a jump, not a motion that is too fast.
const JUMP_RATIO: f64 = 10.0;

/// Slower than this part of its velocity limits an arm counts as resting.
pub const SLOW: f64 = 1e-3;

/// What a robot's configuration allows; elements beyond `joints` are not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Smallest position, rad.
    pub lower: [f64; JOINTS_MAX],
    /// Largest position, rad.
    pub upper: [f64; JOINTS_MAX],
    /// Largest |velocity|, rad/s.
    pub velocity_max: [f64; JOINTS_MAX],
    /// Largest |acceleration|, rad/s².
    pub acceleration_max: [f64; JOINTS_MAX],
    /// Largest |jerk|, rad/s³: what motions are planned with, and what a net is checked for before it starts; the guard
    /// itself does not look at it.
    pub jerk_max: [f64; JOINTS_MAX],
    /// Number of joints, at most [`JOINTS_MAX`].
    pub joints: usize,
}

/// Which rule a set-point broke.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ViolationKind {
    /// NaN, infinite or missing.
    NotFinite,
    /// Outside of lower..upper.
    Range,
    /// Faster than the velocity limit.
    Velocity,
    /// A change of velocity beyond the acceleration limit.
    Acceleration,
    /// Not where the device is: the first set-point is away from the hold position, or a step is no motion at all.
    Jump,
    /// A stiffness out of its range.
    Stiffness,
    /// A stiffness that changes too fast.
    StiffnessRate,
    /// A damping ratio out of its range.
    Damping,
    /// Too large a force or torque on top.
    Added,
    /// For another control strategy than the controller runs; value and limit are their numbers.
    Strategy,
    /// Outside of the box of the workspace.
    Workspace,
    /// Nearer to a singular position than the workspace allows.
    Singularity,
}

impl ViolationKind {
    /// All kinds, in order of their numbers from 1.
    pub const ALL: [ViolationKind; 12] = [
        ViolationKind::NotFinite,
        ViolationKind::Range,
        ViolationKind::Velocity,
        ViolationKind::Acceleration,
        ViolationKind::Jump,
        ViolationKind::Stiffness,
        ViolationKind::StiffnessRate,
        ViolationKind::Damping,
        ViolationKind::Added,
        ViolationKind::Strategy,
        ViolationKind::Workspace,
        ViolationKind::Singularity,
    ];

    /// The number that crosses processes; 0 means no violation.
    #[must_use]
    pub fn number(self) -> u32 {
        self as u32 + 1
    }

    /// From a number that came from another process.
    #[must_use]
    pub fn from_number(number: u32) -> Option<ViolationKind> {
        Self::ALL.get((number as usize).checked_sub(1)?).copied()
    }

    /// True for what is a matter of the whole device: no joint and no axis has to do with it.
    #[must_use]
    pub fn is_of_device(self) -> bool {
        matches!(self, Self::Strategy | Self::Singularity)
    }
}

/// The name of an axis that stands in the place of a joint, counted from 0; `None`: it is a joint.
#[must_use]
pub fn axis(joint: usize) -> Option<&'static str> {
    AXES.get(joint.checked_sub(JOINTS_MAX)?).copied()
}

/// A refused set-point: which joint, what was asked, what is allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// The rule.
    pub kind: ViolationKind,
    /// The joint, counted from 0 (people see it counted from 1); from [`JOINTS_MAX`] on an axis of the task frame.
    pub joint: u8,
    /// What was asked for, in [`Violation::unit`], with its sign.
    pub value: f64,
    /// The limit that it broke, in [`Violation::unit`].
    pub limit: f64,
}

impl Violation {
    /// The unit of `value` and `limit`.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        let along = (JOINTS_MAX..JOINTS_MAX + 3).contains(&usize::from(self.joint));
        match self.kind {
            ViolationKind::Stiffness if along => "N/m",
            ViolationKind::Stiffness => "N·m/rad",
            ViolationKind::StiffnessRate if along => "N/m/s",
            ViolationKind::StiffnessRate => "N·m/rad/s",
            ViolationKind::Added if along => "N",
            ViolationKind::Added => "N·m",
            ViolationKind::Damping | ViolationKind::Strategy | ViolationKind::Singularity => "",
            ViolationKind::Workspace => "m",
            ViolationKind::NotFinite | ViolationKind::Range | ViolationKind::Jump => "rad",
            ViolationKind::Velocity => "rad/s",
            ViolationKind::Acceleration => "rad/s²",
        }
    }
}

impl From<Leaves> for Violation {
    fn from(leaves: Leaves) -> Violation {
        match leaves {
            Leaves::Box { axis, value, limit } => Violation {
                kind: ViolationKind::Workspace,
                joint: JOINTS_MAX as u8 + axis,
                value,
                limit,
            },
            Leaves::Singular { near, limit } => Violation {
                kind: ViolationKind::Singularity,
                joint: 0,
                value: near.distance,
                limit,
            },
        }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, limit, unit) = (self.value, self.limit, self.unit());
        match axis(usize::from(self.joint)) {
            _ if self.kind.is_of_device() => {}
            Some(axis) => write!(f, "axis {axis}: ")?,
            None => write!(f, "joint {}: ", u16::from(self.joint) + 1)?,
        }
        match self.kind {
            ViolationKind::NotFinite => {
                write!(f, "the set-point {value} is not a finite number of {unit}")
            }
            ViolationKind::Range => write!(
                f,
                "position {value} {unit} is beyond the limit {limit} {unit}"
            ),
            ViolationKind::Velocity => write!(f, "velocity {value} {unit} exceeds {limit} {unit}"),
            ViolationKind::Acceleration => {
                write!(f, "acceleration {value} {unit} exceeds {limit} {unit}")
            }
            ViolationKind::Jump => write!(f, "jump of {value} {unit}, allowed are {limit} {unit}"),
            ViolationKind::Stiffness => write!(
                f,
                "stiffness {value} {unit} is beyond the limit {limit} {unit}"
            ),
            ViolationKind::StiffnessRate => write!(
                f,
                "the stiffness changes with {value} {unit}, allowed are {limit} {unit}"
            ),
            ViolationKind::Damping => {
                write!(f, "damping ratio {value} is beyond the limit {limit}")
            }
            ViolationKind::Added => {
                write!(f, "{value} {unit} on top exceed {limit} {unit}")
            }
            ViolationKind::Strategy => {
                let (asked, runs) = (Strategy::words(value as u64), Strategy::words(limit as u64));
                write!(
                    f,
                    "the set-point is for {asked}, the controller runs {runs}"
                )
            }
            ViolationKind::Workspace => {
                write!(
                    f,
                    "{value} {unit} is outside of the workspace, the bound is {limit} {unit}"
                )
            }
            ViolationKind::Singularity => write!(
                f,
                "too near to a singular position: {value}, the workspace allows {limit}"
            ),
        }
    }
}

impl core::error::Error for Violation {}

/// The set-points that the next one is compared with.
#[derive(Debug, Clone, Copy)]
struct History {
    position: [f64; JOINTS_MAX],
    velocity: [f64; JOINTS_MAX],
    /// Logical time between the last two set-points, s; `None` after the first one, when the device rests.
    dt_s: Option<f64>,
}

/// One joint's limits.
#[derive(Clone, Copy)]
struct Joint {
    index: u8,
    lower: f64,
    upper: f64,
    velocity_max: f64,
    acceleration_max: f64,
}

/// The check of one device's set-points.
#[derive(Debug, Clone)]
pub struct Guard {
    limits: JointLimits,
    first_tolerance: f64,
    history: Option<History>,
    /// `None`: the arm is commanded in position only.
    impedance: Option<ImpedanceLimits>,
    last_impedance: Option<Impedance>,
    /// `None`: the arm may be anywhere.
    stay: Option<Stay>,
}

impl Guard {
    /// A guard that has seen no set-point yet. `first_tolerance`: how far the first set-point may be from where the
    /// device holds, rad per joint.
    #[must_use]
    pub fn new(limits: JointLimits, first_tolerance: f64) -> Self {
        Self {
            limits,
            first_tolerance,
            history: None,
            impedance: None,
            last_impedance: None,
            stay: None,
        }
    }

    /// What the robot's configuration allows of impedance set-points; `None`: there are none.
    #[must_use]
    pub fn with_impedance(self, impedance: Option<ImpedanceLimits>) -> Self {
        Self { impedance, ..self }
    }

    /// Where the arm may be; `None`: anywhere, as a device without kinematics.
    #[must_use]
    pub fn with_workspace(self, arm: Option<Arm>, space: Option<Workspace>) -> Self {
        let stay = arm.zip(space).map(|(arm, space)| Stay::new(arm, space));
        Self { stay, ..self }
    }

    /// The first set-point of a device that becomes commanded: it must match `hold`, where the driver holds the device
    /// at rest (both rad, one element a joint). The history begins here.
    ///
    /// # Errors
    /// The first joint that is not finite, out of range or not at its hold position; the history stays as it was.
    pub fn first(&mut self, position: &[f64], hold: &[f64]) -> Result<(), Violation> {
        let mut history = History {
            position: [0.0; JOINTS_MAX],
            velocity: [0.0; JOINTS_MAX],
            dt_s: None,
        };
        for ((joint, kept), index) in self.joints().zip(&mut history.position).zip(0..) {
            let asked = element(position, index);
            joint.check_position(asked)?;
            let jump = asked - element(hold, index);
            joint.check(ViolationKind::Jump, jump, self.first_tolerance, 0.0)?;
            *kept = asked;
        }
        if let Some(stay) = &mut self.stay {
            stay.begin(&history.position);
        }
        self.history = Some(history);
        self.last_impedance = None;
        Ok(())
    }

    /// A further set-point (rad, one element a joint), `dt_s` of logical time (> 0) after the last one that was
    /// accepted. Velocity and acceleration are finite differences. Without a [`Guard::first`] before, it is a jump.
    ///
    /// # Errors
    /// The first joint that breaks a rule, or where it leaves its workspace; the history stays at the last accepted set-point.
    pub fn check(&mut self, position: &[f64], dt_s: f64) -> Result<(), Violation> {
        let Some(mut history) = self.history else {
            let value = element(position, 0);
            return Err(Violation {
                kind: ViolationKind::Jump,
                joint: 0,
                value,
                limit: self.first_tolerance,
            });
        };
        // Time that does not pass makes every rate NaN, which is refused.
        let dt_s = if dt_s > 0.0 { dt_s } else { f64::NAN };
        // Velocities are means over their intervals, so they are half of each interval apart.
        let between_s = 0.5 * (dt_s + history.dt_s.unwrap_or(dt_s));
        let kept = history.position.iter_mut().zip(&mut history.velocity);
        for ((joint, (last_position, last_velocity)), index) in self.joints().zip(kept).zip(0..) {
            let asked = element(position, index);
            joint.check_position(asked)?;
            let step = asked - *last_position;
            let velocity = step / dt_s;
            let rounding = 8.0 * f64::EPSILON * (1.0 + libm::fabs(asked)) / dt_s;
            joint.check_velocity(step, velocity, dt_s, rounding)?;
            let acceleration = (velocity - *last_velocity) / between_s;
            let limit = joint.acceleration_max;
            joint.check(
                ViolationKind::Acceleration,
                acceleration,
                limit,
                rounding / between_s,
            )?;
            (*last_position, *last_velocity) = (asked, velocity);
        }
        if let Some(stay) = &mut self.stay {
            stay.check(&history.position)?;
        }
        history.dt_s = Some(dt_s);
        self.history = Some(history);
        Ok(())
    }

    /// The first set-point after a gap, while the device still plays the set-points before it: it must match the last one
    /// that was accepted, where the device will rest (see [`Guard::rests`]). The history begins here.
    ///
    /// # Errors
    /// As [`Guard::first`]; without a set-point before it, it is a jump.
    pub fn resume(&mut self, position: &[f64]) -> Result<(), Violation> {
        match self.history {
            Some(last) => self.first(position, &last.position),
            None => Err(Violation {
                kind: ViolationKind::Jump,
                joint: 0,
                value: element(position, 0),
                limit: self.first_tolerance,
            }),
        }
    }

    /// The last accepted set-points are so slow that a device may just be left at the last one: slower than this part of
    /// the velocity limits, and than one period of the acceleration limits.
    #[must_use]
    pub fn rests(&self) -> bool {
        let Some(history) = self.history else {
            return true;
        };
        let Some(dt_s) = history.dt_s else {
            return true;
        };
        self.joints()
            .zip(history.velocity)
            .all(|(joint, velocity)| {
                libm::fabs(velocity)
                    <= libm::fmin(SLOW * joint.velocity_max, joint.acceleration_max * dt_s)
            })
    }

    fn joints(&self) -> impl Iterator<Item = Joint> + use<> {
        let JointLimits {
            lower,
            upper,
            velocity_max,
            acceleration_max,
            joints,
            ..
        } = self.limits;
        let ranges = lower.into_iter().zip(upper);
        let rates = velocity_max.into_iter().zip(acceleration_max);
        let rows = ranges.zip(rates).zip(0_u8..).take(joints);
        rows.map(
            |(((lower, upper), (velocity_max, acceleration_max)), index)| Joint {
                index,
                lower,
                upper,
                velocity_max,
                acceleration_max,
            },
        )
    }
}

impl Joint {
    fn check_position(&self, asked: f64) -> Result<(), Violation> {
        let violation = |kind, limit| {
            Err(Violation {
                kind,
                joint: self.index,
                value: asked,
                limit,
            })
        };
        if !asked.is_finite() {
            return violation(ViolationKind::NotFinite, f64::NAN);
        }
        // Asked this way round, a limit that is NaN refuses.
        let above = asked >= self.lower - RELATIVE_TOLERANCE * libm::fabs(self.lower);
        let below = asked <= self.upper + RELATIVE_TOLERANCE * libm::fabs(self.upper);
        if !above {
            return violation(ViolationKind::Range, self.lower);
        }
        if !below {
            return violation(ViolationKind::Range, self.upper);
        }
        Ok(())
    }

    fn check_velocity(
        &self,
        step: f64,
        velocity: f64,
        dt_s: f64,
        rounding: f64,
    ) -> Result<(), Violation> {
        if libm::fabs(velocity) > JUMP_RATIO * self.velocity_max {
            let limit = self.velocity_max * dt_s;
            return Err(Violation {
                kind: ViolationKind::Jump,
                joint: self.index,
                value: step,
                limit,
            });
        }
        self.check(
            ViolationKind::Velocity,
            velocity,
            self.velocity_max,
            rounding,
        )
    }

    /// |value| ≤ limit, but for rounding; a NaN on either side refuses.
    fn check(
        &self,
        kind: ViolationKind,
        value: f64,
        limit: f64,
        rounding: f64,
    ) -> Result<(), Violation> {
        let excused = libm::fmin(rounding, limit * ROUNDING_MAX);
        if libm::fabs(value) <= limit * (1.0 + RELATIVE_TOLERANCE) + excused {
            Ok(())
        } else {
            Err(Violation {
                kind,
                joint: self.index,
                value,
                limit,
            })
        }
    }
}

/// A missing element is no number.
fn element(values: &[f64], index: usize) -> f64 {
    values.get(index).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests;
