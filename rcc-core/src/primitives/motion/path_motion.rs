//! Shared part of all motions along a path: inputs, outputs and the step of a cycle. Run by the real-time thread.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::{
    Leg, LegSignals, MotionLimits, MotionState, PathRequest, PathSegment, SpeedOverride,
    SpeedProfile, StopReserve, leg_row,
};
use crate::pose::Pose;
use crate::primitive::{
    Bool, DefaultValue, Device, Int, MotionIndex, Parameter, ParameterKind, Port, PortType, Real,
    Slot, UnitRule,
};
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Type};
use crate::unit::Unit;

/// `stop`, `pause`, `speed`.
pub(super) const INPUTS: [Port; 3] = [
    Port::bool(
        "stop",
        "brings the motion to rest on the path; once true, the motion stays stopped",
    )
    .default(DefaultValue::Bool(false)),
    Port::bool(
        "pause",
        "brings the motion to rest on the path; when false again, the motion continues",
    )
    .default(DefaultValue::Bool(false)),
    Port::real(
        "speed",
        UnitRule::ONE,
        "speed override, may change at any time; computed values above 1 count as 1, values of 0 or less are a pause",
    )
    .default(DefaultValue::Real(1.0)).within(0.0, 1.0),
];

/// Effect of null inputs.
pub(super) const NULL: &str = "a null `stop` counts as true, because an unknown condition must stop the motion; a null `pause` or `speed` is a pause";

/// `joints`, `pose`, `done`, `progress`, `distance`, `speed`, `acceleration`, `leg`.
pub(super) const OUTPUTS: [Port; 8] = [
    Port::new(
        "joints",
        PortType::Joints,
        UnitRule::Joint(0),
        "set-point of the joints, A1 first: for JointPositionCommand",
    )
    .diagnostic(),
    Port::typed(
        "pose",
        Type::Pose,
        "set-point of the flange in the arm's base",
    )
    .diagnostic(),
    Port::bool("done", "at rest: at the end, or on the path after a stop"),
    Port::real(
        "progress",
        UnitRule::ONE,
        "completed part of the whole path; never decreases",
    )
    .within(0.0, 1.0)
    .diagnostic(),
    Port::real(
        "distance",
        UnitRule::Is(Unit::METRE),
        "distance travelled by the flange since the start",
    )
    .diagnostic(),
    Port::real(
        "speed",
        UnitRule::Is(Unit::METRE_PER_SECOND),
        "speed of the flange along the path",
    )
    .diagnostic(),
    Port::real(
        "acceleration",
        UnitRule::Is(Unit::METRE_PER_SECOND2),
        "acceleration of the flange along the path; negative while braking. On lines in joint space, blends and splines without arc length it is the acceleration of the path's clock times the length of the tangent, not the derivative of `speed`",
    )
    .diagnostic(),
    Port::int(
        "leg",
        "index of the current leg, from 0; a blend belongs to the leg before it",
    )
    .diagnostic(),
];

/// Defines the struct of operands of a motion: the shared ports, its own parameters, the motion and the sizes. With
/// `and flange limits`, the parameters of one segment follow its own, and `build` makes the path of that segment.
macro_rules! motion_operands {
    ($name:ident { $($field:ident: $kind:ty),+ $(,)? } and flange limits $(, $size:ident)?) => {
        $crate::primitives::motion::path_motion::motion_operands! {
            $name {
                $($field: $kind,)+
                velocity: $crate::primitive::Slot<$crate::primitive::Real>,
                acceleration: $crate::primitive::Slot<$crate::primitive::Real>,
                jerk: $crate::primitive::Slot<$crate::primitive::Real>,
                angular_velocity: $crate::primitive::Slot<$crate::primitive::Real>,
                angular_acceleration: $crate::primitive::Slot<$crate::primitive::Real>,
                angular_jerk: $crate::primitive::Slot<$crate::primitive::Real>,
                scale: $crate::primitive::Slot<$crate::primitive::Real>,
                time_optimal: $crate::primitive::Slot<$crate::primitive::Bool>,
                stops: $crate::primitive::Slot<$crate::primitive::Int>,
                arm_angle: $crate::primitive::Slot<$crate::primitive::Real>,
                elbow: $crate::primitive::Slot<$crate::primitive::Int>,
            } $(, $size)?
        }

        impl $name {
            fn build(
                self,
                preparation: &mut $crate::frame::Preparation<'_>,
                from: Option<$crate::pose::Pose>,
                segment: $crate::path::PathSegment<'_>,
            ) -> Result<(), $crate::frame::PrepareFault> {
                let limits = $crate::primitives::motion::path_motion::FlangeLimits {
                    line: [self.velocity, self.acceleration, self.jerk],
                    turn: [self.angular_velocity, self.angular_acceleration, self.angular_jerk],
                    scale: self.scale,
                    time_optimal: self.time_optimal,
                    stops: self.stops,
                    arm_angle: self.arm_angle,
                    elbow: self.elbow,
                };
                limits.build(preparation, (self.device, self.motion), from, segment)
            }
        }
    };
    ($name:ident { $($field:ident: $kind:ty),+ $(,)? } $(, $size:ident)?) => {
        $crate::primitive::operands! {
            struct $name {
                stop: $crate::primitive::Slot<$crate::primitive::Bool>,
                pause: $crate::primitive::Slot<$crate::primitive::Bool>,
                speed: $crate::primitive::Slot<$crate::primitive::Real>,
                joints: $crate::primitive::Slot<$crate::primitive::Real>,
                flange_pose: $crate::primitive::Slot<$crate::pose::Pose>,
                done: $crate::primitive::Slot<$crate::primitive::Bool>,
                progress: $crate::primitive::Slot<$crate::primitive::Real>,
                distance: $crate::primitive::Slot<$crate::primitive::Real>,
                flange_speed: $crate::primitive::Slot<$crate::primitive::Real>,
                flange_acceleration: $crate::primitive::Slot<$crate::primitive::Real>,
                leg: $crate::primitive::Slot<$crate::primitive::Int>,
                device: $crate::primitive::Device,
                $($field: $kind,)+
                motion: $crate::primitive::MotionIndex,
                width: u32,
                $($size: u32,)?
            }
        }

        impl $crate::primitive::Step for $name {
            fn step(self, frame: &mut $crate::frame::Frame<'_>) -> Option<()> {
                let ports = $crate::primitives::motion::path_motion::ports_of!(self);
                ports.step(frame, self.motion)
            }
        }
    };
}
pub(super) use motion_operands;

/// The [`Ports`] among the operands of a motion, whose structs have these fields in common and no trait.
macro_rules! ports_of {
    ($motion:expr) => {
        $crate::primitives::motion::path_motion::Ports {
            stop: $motion.stop,
            pause: $motion.pause,
            speed: $motion.speed,
            joints: $motion.joints,
            width: $motion.width,
            pose: $motion.flange_pose,
            done: $motion.done,
            progress: $motion.progress,
            distance: $motion.distance,
            flange_speed: $motion.flange_speed,
            acceleration: $motion.flange_acceleration,
            leg: $motion.leg,
        }
    };
}
pub(super) use ports_of;

/// The ports of every motion.
pub(super) struct Ports {
    pub stop: Slot<Bool>,
    pub pause: Slot<Bool>,
    pub speed: Slot<Real>,
    pub joints: Slot<Real>,
    pub width: u32,
    pub pose: Slot<Pose>,
    pub done: Slot<Bool>,
    pub progress: Slot<Real>,
    pub distance: Slot<Real>,
    pub flange_speed: Slot<Real>,
    pub acceleration: Slot<Real>,
    pub leg: Slot<Int>,
}

/// Part of the joints' velocity, acceleration and jerk limits to use.
pub(super) const SCALE: Parameter = Parameter::real(
    "scale",
    UnitRule::ONE,
    "part of the velocity, acceleration and jerk limits of each joint that the motion may use",
)
.default(DefaultValue::Real(1.0))
.above(0.0)
.at_most(1.0);

/// Selects time-optimal path parameterization.
pub(super) const TIME_OPTIMAL: Parameter = Parameter::bool(
    "time_optimal",
    "computes the speed profile that reaches the end in minimum time within all limits; a given velocity is then only a limit",
)
.default(DefaultValue::Bool(false));

/// Words of [`STOPS`], by their numbers.
const STOP_RESERVES: &[&str] = &["keep", "give"];

/// The reserve of a time-optimal motion for being slowed down.
pub(super) const STOPS: Parameter = Parameter::new(
    "stops",
    ParameterKind::Word(STOP_RESERVES),
    "for `time_optimal`; keep: 15 % of the limits of acceleration and jerk are reserved for being slowed down; give: 2 %, so the motion ends sooner, but a pause or an override may take seconds",
)
.default(DefaultValue::Word("keep"));

/// The arm angle at the end.
pub(super) const ARM_ANGLE: Parameter = Parameter::new(
    "arm_angle",
    ParameterKind::Value(PortType::Is(Type::Real), UnitRule::RADIAN),
    "for seven joints: arm angle at the end (with numeric inverse kinematics: position of the redundant joint), approached along the path by the shorter way; if omitted, `elbow` decides",
)
.default(DefaultValue::Null);

/// Motion of the elbow.
pub(super) const ELBOW: Parameter = Parameter::new(
    "elbow",
    ParameterKind::Word(leg_row::ELBOWS),
    "stays: keeps the arm angle of the start; middle: the elbow moves along the path to the middle of the range that the joint limits allow at the end",
)
.default(DefaultValue::Word("stays"));

/// Returns the speed profile that `time_optimal` and `stops` select.
pub(super) fn pace(
    preparation: &Preparation<'_>,
    time_optimal: Slot<Bool>,
    stops: Slot<Int>,
) -> SpeedProfile {
    match (preparation.get(time_optimal), preparation.get(stops)) {
        (1, 1) => SpeedProfile::TimeOptimal(StopReserve::Give),
        (1, _) => SpeedProfile::TimeOptimal(StopReserve::Keep),
        _ => SpeedProfile::Adaptive,
    }
}

/// The parameters of a motion of one segment.
pub(super) struct FlangeLimits {
    /// Velocity, acceleration, jerk.
    pub line: [Slot<Real>; 3],
    /// Angular velocity, acceleration, jerk.
    pub turn: [Slot<Real>; 3],
    pub scale: Slot<Real>,
    pub time_optimal: Slot<Bool>,
    pub stops: Slot<Int>,
    pub arm_angle: Slot<Real>,
    pub elbow: Slot<Int>,
}

impl FlangeLimits {
    /// Builds the path of one segment.
    pub(super) fn build(
        self,
        preparation: &mut Preparation<'_>,
        (device, motion): (Device, MotionIndex),
        from: Option<Pose>,
        segment: PathSegment<'_>,
    ) -> Result<(), PrepareFault> {
        let limits =
            |slots: [Slot<Real>; 3]| MotionLimits::of(slots.map(|slot| preparation.get(slot)));
        let elbow = preparation.get(self.elbow) as f64;
        let leg = Leg {
            line: limits(self.line),
            turn: limits(self.turn),
            elbow: leg_row::elbow(preparation.get(self.arm_angle), elbow),
            scale: preparation.get(self.scale),
            ..Leg::new(segment)
        };
        let request = PathRequest {
            device: device.0,
            from,
            legs: &[leg],
            pace: pace(preparation, self.time_optimal, self.stops),
        };
        preparation.motions.path(motion.0, &request)
    }
}

/// `velocity`, `acceleration`, `jerk` and the same for the orientation: limits of the flange. Null: limited only by the
/// joints.
pub(super) const FLANGE: [Parameter; 6] = [
    limit(
        "velocity",
        Unit::METRE_PER_SECOND,
        "speed along the path: guaranteed, or the motion is refused; if omitted, about as fast as the joints allow, by a time law where that is much sooner than one acceleration for the whole path",
    ),
    limit(
        "acceleration",
        Unit::METRE_PER_SECOND2,
        "largest acceleration of the flange; if omitted, limited by the joints",
    ),
    limit(
        "jerk",
        Unit::METRE_PER_SECOND3,
        "largest jerk of the flange; if omitted, limited by the joints",
    ),
    limit(
        "angular_velocity",
        Unit::RADIAN_PER_SECOND,
        "largest angular speed; if omitted, limited by the joints",
    ),
    limit(
        "angular_acceleration",
        Unit::RADIAN_PER_SECOND2,
        "largest angular acceleration; if omitted, limited by the joints",
    ),
    limit(
        "angular_jerk",
        Unit::RADIAN_PER_SECOND3,
        "largest angular jerk; if omitted, limited by the joints",
    ),
];

const fn limit(name: &'static str, unit: Unit, doc: &'static str) -> Parameter {
    Parameter::new(
        name,
        ParameterKind::Value(PortType::Is(Type::Real), UnitRule::Is(unit)),
        doc,
    )
    .default(DefaultValue::Null)
    .above(0.0)
}

impl Ports {
    /// Runs one cycle of a motion: its ports in the order of [`INPUTS`] and [`OUTPUTS`], its index, the width of `joints`.
    pub(super) fn step(self, frame: &mut Frame<'_>, motion: MotionIndex) -> Option<()> {
        self.step_leg(frame, motion, LegSignals::RUN).map(|_| ())
    }

    /// As [`Ports::step`], with the conditions of the current leg; returns the state of the motion, if it exists.
    pub(super) fn step_leg(
        self,
        frame: &mut Frame<'_>,
        motion: MotionIndex,
        signals: LegSignals,
    ) -> Option<Option<MotionState>> {
        let speed_override = SpeedOverride {
            stop: frame.get(self.stop)? != 0,
            pause: frame.get(self.pause)? != 0,
            speed: frame.get(self.speed)?,
        };
        let motions = &mut *frame.motions;
        let Some(state) = motions.step_leg(motion.0 as usize, speed_override, signals) else {
            frame.motion_failed = true;
            frame.put_joints(self.joints, self.width, None)?;
            frame.put(self.pose, Pose::NULL)?;
            frame.put(self.done, NULL_BOOL)?;
            for real in [
                self.progress,
                self.distance,
                self.flange_speed,
                self.acceleration,
            ] {
                frame.put(real, NULL_REAL)?;
            }
            frame.put(self.leg, NULL_INT)?;
            return Some(None);
        };
        let known = state.joints.iter().all(|joint| joint.is_finite());
        frame.put_joints(self.joints, self.width, known.then_some(&state.joints))?;
        frame.put(self.pose, state.pose)?;
        frame.put(self.done, u8::from(state.path.done))?;
        frame.put(self.progress, state.progress)?;
        frame.put(self.distance, state.distance)?;
        frame.put(self.flange_speed, state.speed)?;
        frame.put(self.acceleration, state.acceleration)?;
        frame.put(self.leg, i64::from(state.leg))?;
        Some(Some(state))
    }
}
