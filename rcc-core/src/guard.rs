//! The check of an arm's set-point, in each cycle: by the executor's real-time thread before it is published, and once
//! more by the thread of the driver's host before it is sent, without the workspace. Pure.

use core::fmt;

use crate::impedance::{AXES, ControlMode, Impedance, ImpedanceLimits};
use crate::joints::{ArmMotion, JOINTS_MAX};
use crate::kinematics::Arm;
use crate::workspace::{Workspace, WorkspaceGuard, WorkspaceViolation};

mod impedance;

pub use crate::joints::JointLimits;

/// Relative tolerance of every limit: set-points that use a limit fully are subject to rounding.
pub const RELATIVE_TOLERANCE: f64 = 1e-9;
/// Relative tolerance of a jerk limit where a trajectory is checked in advance: the jerk is a third difference of computed
/// positions.
pub const JERK_TOLERANCE: f64 = 1e-2;

/// Differences of positions contain rounding errors; the tolerance for them is at most this part of a limit.
const ROUNDING_MAX: f64 = 1e-3;

/// A step that needs more than this many times the velocity limit is reported as a jump instead of a velocity
/// violation.
const JUMP_RATIO: f64 = 10.0;

/// An arm that is slower than this part of its velocity limits counts as being at rest.
pub const SLOW: f64 = 1e-3;

/// The rule that a set-point violated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ViolationKind {
    /// NaN, infinite or missing.
    NotFinite,
    /// Outside of lower..upper.
    Range,
    /// Faster than the velocity limit.
    Velocity,
    /// Acceleration beyond the limit.
    Acceleration,
    /// A discontinuity: the first set-point is away from the hold position, or a step is too large to be a motion.
    Jump,
    /// Stiffness outside its range.
    Stiffness,
    /// Stiffness that changes too fast.
    StiffnessRate,
    /// Damping ratio outside its range.
    Damping,
    /// Additional force or torque beyond its limit.
    Added,
    /// The set-point is for another control strategy than the one the controller runs; value and limit are the strategy
    /// numbers.
    Strategy,
    /// Outside of the box of the workspace.
    Workspace,
    /// Closer to a singularity than the workspace allows.
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

    /// Returns the kind of a number that came from another process; `None` if the number is unknown.
    #[must_use]
    pub fn from_number(number: u32) -> Option<ViolationKind> {
        Self::ALL.get((number as usize).checked_sub(1)?).copied()
    }

    /// Returns true for violations that concern the whole device instead of a joint or axis.
    #[must_use]
    pub fn is_of_device(self) -> bool {
        matches!(self, Self::Strategy | Self::Singularity)
    }
}

/// Returns the axis name of a `joint` index (from 0) that stands for an axis; `None`: the index is a joint.
#[must_use]
pub fn axis(joint: usize) -> Option<&'static str> {
    AXES.get(joint.checked_sub(JOINTS_MAX)?).copied()
}

/// A refused set-point: joint, requested value and limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// The rule.
    pub kind: ViolationKind,
    /// The joint, counted from 0 (displayed counted from 1); indices from [`JOINTS_MAX`] on are axes: of the task frame for
    /// impedance, of the arm's base for the workspace.
    pub joint: u8,
    /// The requested value, in [`Violation::unit`], with its sign.
    pub value: f64,
    /// The violated limit, in [`Violation::unit`].
    pub limit: f64,
}

impl Violation {
    /// Returns the unit of `value` and `limit` for rotary joints; empty if they are dimensionless.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        self.unit_of(false)
    }

    /// As [`Violation::unit`], for a device whose joints are linear axes if `linear` is set.
    #[must_use]
    pub fn unit_of(&self, linear: bool) -> &'static str {
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
            ViolationKind::NotFinite | ViolationKind::Range | ViolationKind::Jump if linear => "m",
            ViolationKind::Velocity if linear => "m/s",
            ViolationKind::Acceleration if linear => "m/s²",
            ViolationKind::NotFinite | ViolationKind::Range | ViolationKind::Jump => "rad",
            ViolationKind::Velocity => "rad/s",
            ViolationKind::Acceleration => "rad/s²",
        }
    }
}

impl From<WorkspaceViolation> for Violation {
    fn from(leaves: WorkspaceViolation) -> Violation {
        match leaves {
            WorkspaceViolation::Box { axis, value, limit } => Violation {
                kind: ViolationKind::Workspace,
                joint: JOINTS_MAX as u8 + axis,
                value,
                limit,
            },
            WorkspaceViolation::Singular { near, limit } => Violation {
                kind: ViolationKind::Singularity,
                joint: 0,
                value: near.distance,
                limit,
            },
        }
    }
}

/// A violation in words, for a device whose joints are linear axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearViolation(pub Violation);

impl fmt::Display for LinearViolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.write(f, true)
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, false)
    }
}

impl Violation {
    fn write(&self, f: &mut fmt::Formatter<'_>, linear: bool) -> fmt::Result {
        let (value, limit, unit) = (self.value, self.limit, self.unit_of(linear));
        match axis(usize::from(self.joint)) {
            _ if self.kind.is_of_device() => {}
            Some(axis) => write!(f, "axis {axis}: ")?,
            None => write!(f, "joint {}: ", u16::from(self.joint) + 1)?,
        }
        match self.kind {
            ViolationKind::NotFinite => {
                write!(f, "set-point {value} {unit} is not finite")
            }
            ViolationKind::Range => write!(
                f,
                "position {value} {unit} is beyond the limit {limit} {unit}"
            ),
            ViolationKind::Velocity => write!(f, "velocity {value} {unit} exceeds {limit} {unit}"),
            ViolationKind::Acceleration => {
                write!(f, "acceleration {value} {unit} exceeds {limit} {unit}")
            }
            ViolationKind::Jump => write!(f, "jump of {value} {unit} exceeds {limit} {unit}"),
            ViolationKind::Stiffness => write!(
                f,
                "stiffness {value} {unit} is beyond the limit {limit} {unit}"
            ),
            ViolationKind::StiffnessRate => write!(
                f,
                "rate of change of the stiffness {value} {unit} exceeds {limit} {unit}"
            ),
            ViolationKind::Damping => {
                write!(f, "damping ratio {value} is beyond the limit {limit}")
            }
            ViolationKind::Added => {
                write!(f, "additional load {value} {unit} exceeds {limit} {unit}")
            }
            ViolationKind::Strategy => {
                let (requested, runs) = (
                    ControlMode::label(value as u64),
                    ControlMode::label(limit as u64),
                );
                write!(
                    f,
                    "the set-point is for {requested}, but the controller runs {runs}"
                )
            }
            ViolationKind::Workspace => {
                write!(
                    f,
                    "position {value} {unit} is outside the workspace: the bound is {limit} {unit}"
                )
            }
            ViolationKind::Singularity => write!(
                f,
                "distance {value} from a singularity is below {limit}, the minimum of the workspace"
            ),
        }
    }
}

impl core::error::Error for Violation {}

/// State of the previous set-points, which the next one is compared with.
#[derive(Debug, Clone, Copy)]
struct SetPointHistory {
    position: [f64; JOINTS_MAX],
    velocity: [f64; JOINTS_MAX],
    /// The last two accelerations, the older one first.
    accelerations: [[f64; JOINTS_MAX]; 2],
    /// Logical time between the last two set-points, s; `None` after the first one, when the device is at rest.
    dt_s: Option<f64>,
}

/// The limits of one joint.
#[derive(Clone, Copy)]
struct JointBounds {
    index: u8,
    lower: f64,
    upper: f64,
    velocity_max: f64,
    acceleration_max: f64,
}

/// Checks the set-points of one device.
#[derive(Debug, Clone)]
pub struct Guard {
    limits: JointLimits,
    first_tolerance: f64,
    history: Option<SetPointHistory>,
    /// `None`: the arm is commanded in position only.
    impedance: Option<ImpedanceLimits>,
    last_impedance: Option<Impedance>,
    /// `None`: the workspace is unrestricted.
    workspace: Option<WorkspaceGuard>,
}

impl Guard {
    /// Creates a guard without history. `first_tolerance`: largest distance of the first set-point from the hold
    /// position, rad per joint.
    #[must_use]
    pub fn new(limits: JointLimits, first_tolerance: f64) -> Self {
        Self {
            limits,
            first_tolerance,
            history: None,
            impedance: None,
            last_impedance: None,
            workspace: None,
        }
    }

    /// Sets the limits of impedance set-points; `None`: impedance set-points are refused.
    #[must_use]
    pub fn with_impedance(self, impedance: Option<ImpedanceLimits>) -> Self {
        Self { impedance, ..self }
    }

    /// Sets the workspace; `None`: unrestricted, as for a device without kinematics.
    #[must_use]
    pub fn with_workspace(self, arm: Option<Arm>, space: Option<Workspace>) -> Self {
        let workspace = arm
            .zip(space)
            .map(|(arm, space)| WorkspaceGuard::new(arm, space));
        Self { workspace, ..self }
    }

    /// Checks the first set-point of a device that becomes commanded: it must match `hold`, where the driver holds the
    /// device at rest (both rad, one element per joint). The history starts here.
    ///
    /// # Errors
    /// Returns the first joint that is not finite, out of range or not at its hold position; the history is then
    /// unchanged.
    pub fn first(&mut self, position: &[f64], hold: &[f64]) -> Result<(), Violation> {
        let mut history = SetPointHistory {
            position: [0.0; JOINTS_MAX],
            velocity: [0.0; JOINTS_MAX],
            accelerations: [[0.0; JOINTS_MAX]; 2],
            dt_s: None,
        };
        for ((joint, stored), index) in self.joints().zip(&mut history.position).zip(0..) {
            let requested = element(position, index);
            joint.check_position(requested)?;
            let jump = requested - element(hold, index);
            joint.check(ViolationKind::Jump, jump, self.first_tolerance, 0.0)?;
            *stored = requested;
        }
        if let Some(workspace) = &mut self.workspace {
            workspace.begin(&history.position);
        }
        self.history = Some(history);
        self.last_impedance = None;
        Ok(())
    }

    /// Checks a further set-point (rad, one element per joint), `dt_s` of logical time (> 0) after the last accepted
    /// one. Velocity and acceleration are finite differences. Without a preceding [`Guard::first`], it is a jump.
    ///
    /// # Errors
    /// Returns the first violation, by joint, then of the workspace; the history then stays at the last accepted
    /// set-point.
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
        // A `dt_s` that is not positive makes every rate NaN, which is refused.
        let dt_s = if dt_s > 0.0 { dt_s } else { f64::NAN };
        // Each velocity is the mean over its interval, so two of them are half of each interval apart.
        let between_s = 0.5 * (dt_s + history.dt_s.unwrap_or(dt_s));
        let stored = history.position.iter_mut().zip(&mut history.velocity);
        let [before, last] = &mut history.accelerations;
        *before = *last;
        let stored = stored.zip(last);
        for ((joint, stored), index) in self.joints().zip(stored).zip(0..) {
            let ((last_position, last_velocity), last_acceleration) = stored;
            let requested = element(position, index);
            joint.check_position(requested)?;
            let step = requested - *last_position;
            let velocity = step / dt_s;
            let rounding = 8.0 * f64::EPSILON * (1.0 + libm::fabs(requested)) / dt_s;
            joint.check_velocity(step, velocity, dt_s, rounding)?;
            let acceleration = (velocity - *last_velocity) / between_s;
            let limit = joint.acceleration_max;
            joint.check(
                ViolationKind::Acceleration,
                acceleration,
                limit,
                rounding / between_s,
            )?;
            (*last_position, *last_velocity) = (requested, velocity);
            *last_acceleration = acceleration;
        }
        if let Some(workspace) = &mut self.workspace {
            workspace.check(&history.position)?;
        }
        history.dt_s = Some(dt_s);
        self.history = Some(history);
        Ok(())
    }

    /// Checks the first set-point after a gap, while the device still plays the set-points before it: it must match the
    /// last accepted one, where the device will come to rest (see [`Guard::rests`]). The history starts here.
    ///
    /// # Errors
    /// As [`Guard::first`]; a jump if no set-point was accepted before.
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

    /// Returns the motion at the last accepted set-point; `None` without one.
    ///
    /// Velocity and acceleration are extrapolated from finite differences, the acceleration such that it is never more
    /// than the true one: a motion that is planned from a larger one would exceed the velocity limit before the jerk
    /// limit lets the acceleration end.
    #[must_use]
    pub fn motion(&self) -> Option<ArmMotion> {
        let SetPointHistory {
            position,
            velocity,
            accelerations: [before, last],
            dt_s,
        } = self.history?;
        let mut motion = ArmMotion::at_rest(position);
        let Some(dt_s) = dt_s else {
            return Some(motion);
        };
        let rates = motion.velocity.iter_mut().zip(&mut motion.acceleration);
        let seen = velocity.into_iter().zip(before.into_iter().zip(last));
        let seen = seen.zip(self.limits.jerk_max);
        for ((rate, acceleration), ((velocity, (before, last)), jerk_max)) in rates.zip(seen) {
            let next = 2.0 * last - before;
            let least = libm::fmin(libm::fabs(last), libm::fabs(next)) - jerk_max * dt_s;
            if least > 0.0 && last * next > 0.0 {
                *acceleration = libm::copysign(least, last);
            }
            *rate = velocity + 0.5 * dt_s * *acceleration;
        }
        Some(motion)
    }

    /// Returns true if the last accepted set-points are so slow that the device may simply be left at the last one:
    /// slower than [`SLOW`] times the velocity limits, and than the acceleration limits times one period.
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

    fn joints(&self) -> impl Iterator<Item = JointBounds> + use<> {
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
            |(((lower, upper), (velocity_max, acceleration_max)), index)| JointBounds {
                index,
                lower,
                upper,
                velocity_max,
                acceleration_max,
            },
        )
    }
}

impl JointBounds {
    fn check_position(&self, requested: f64) -> Result<(), Violation> {
        let violation = |kind, limit| {
            Err(Violation {
                kind,
                joint: self.index,
                value: requested,
                limit,
            })
        };
        if !requested.is_finite() {
            return violation(ViolationKind::NotFinite, f64::NAN);
        }
        // The comparison is written so that a NaN limit refuses.
        let above = requested >= self.lower - RELATIVE_TOLERANCE * libm::fabs(self.lower);
        let below = requested <= self.upper + RELATIVE_TOLERANCE * libm::fabs(self.upper);
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

    /// Checks |value| ≤ limit with a tolerance for rounding; a NaN on either side refuses.
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

/// Returns an element, or NaN if it is missing.
fn element(values: &[f64], index: usize) -> f64 {
    values.get(index).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests;
