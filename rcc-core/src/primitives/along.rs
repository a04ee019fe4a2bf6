//! What all motions along a path have in common: inputs, outputs and what a cycle does.
//! The real-time thread.

use crate::frame::{Frame, Preparation};
use crate::path::{ElbowMotion, SpeedOverride, SpeedProfile, leg_row};
use crate::primitive::{DefaultValue, Parameter, ParameterKind, Port, PortType, UnitRule};
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Type};
use crate::unit::Unit;

/// `stop`, `pause`, `speed`.
pub(super) const INPUTS: &[Port] = &[
    Port::bool(
        "stop",
        "brings the motion to rest on the path; once true, it stays stopped",
    )
    .default(DefaultValue::Bool(false)),
    Port::bool(
        "pause",
        "brings the motion to rest on the path; when it is false again, the motion goes on",
    )
    .default(DefaultValue::Bool(false)),
    Port::real(
        "speed",
        UnitRule::ONE,
        "part of the speed, at any time; what is computed above 1 counts as 1, and 0 or less is a pause",
    )
    .default(DefaultValue::Real(1.0)).within(0.0, 1.0),
];

/// What null at the inputs means.
pub(super) const NULL: &str = "a null `stop` counts as true: who cannot say that the motion may go on, stops it; a null `pause` or `speed` is a pause";

/// `joints`, `pose`, `done`, `progress`, `distance`, `speed`, `acceleration`, `leg`.
pub(super) const OUTPUTS: &[Port] = &[
    Port::new(
        "joints",
        PortType::Joints,
        UnitRule::Is(Unit::RADIAN),
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
        "part of the whole path that is behind it; never falls",
    )
    .within(0.0, 1.0)
    .diagnostic(),
    Port::real(
        "distance",
        UnitRule::Is(Unit::METRE),
        "way of the flange since the start",
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
        "acceleration of the flange along the path; below 0 while it brakes",
    )
    .diagnostic(),
    Port::int(
        "leg",
        "the leg that it is on, from 0; a rounding belongs to the leg before it",
    )
    .diagnostic(),
];

/// Operands of inputs and outputs.
pub(super) const PORTS: usize = 11;

/// Part of velocity, acceleration and jerk of the joints.
pub(super) const SCALE: Parameter = Parameter::real(
    "scale",
    UnitRule::ONE,
    "part of velocity, acceleration and jerk of each joint that the motion may use",
)
.default(DefaultValue::Real(1.0))
.above(0.0)
.at_most(1.0);

/// Whether the fastest law is looked for.
pub(super) const TIME_OPTIMAL: Parameter = Parameter::bool(
    "time_optimal",
    "looks for the speed at every place with which the end is reached soonest within all limits; a given velocity is a limit then, no promise",
)
.default(DefaultValue::Bool(false));

/// The arm angle at the end.
pub(super) const ARM_ANGLE: Parameter = Parameter::new(
    "arm_angle",
    ParameterKind::Value(PortType::Is(Type::Real), UnitRule::RADIAN),
    "of seven joints: the arm angle at the end, to which the elbow turns along the path, the shorter way round; without it as `elbow` says",
)
.default(DefaultValue::Null);

/// What the elbow does.
pub(super) const ELBOW: Parameter = Parameter::new(
    "elbow",
    ParameterKind::Word(leg_row::ELBOWS),
    "stays: the arm angle is that of the start; middle: the elbow turns along the path to the middle of what the joint limits allow at the end",
)
.default(DefaultValue::Word("stays"));

/// What both say.
pub(super) fn elbow(preparation: &Preparation<'_>, [arm_angle, elbow]: [u32; 2]) -> ElbowMotion {
    let [arm_angle] = preparation.reals(arm_angle);
    leg_row::elbow(arm_angle, preparation.int(elbow) as f64)
}

/// What `time_optimal` says.
pub(super) fn pace(preparation: &Preparation<'_>, slot: u32) -> SpeedProfile {
    match preparation.bool(slot) {
        1 => SpeedProfile::Fastest,
        _ => SpeedProfile::Even,
    }
}

/// `velocity`, `acceleration`, `jerk` and the same of the orientation: what the flange must keep. Null: what the joints allow.
pub(super) const FLANGE: [Parameter; 6] = [
    limit(
        "velocity",
        Unit::METRE_PER_SECOND,
        "speed along the path: kept, or the motion is refused; without it as fast as the joints allow",
    ),
    limit(
        "acceleration",
        Unit::METRE_PER_SECOND2,
        "largest acceleration of the flange; without it what the joints allow",
    ),
    limit(
        "jerk",
        Unit::METRE_PER_SECOND3,
        "largest jerk of the flange; without it what the joints allow",
    ),
    limit(
        "angular_velocity",
        Unit::RADIAN_PER_SECOND,
        "largest angular speed; without it what the joints allow",
    ),
    limit(
        "angular_acceleration",
        Unit::RADIAN_PER_SECOND2,
        "largest angular acceleration; without it what the joints allow",
    ),
    limit(
        "angular_jerk",
        Unit::RADIAN_PER_SECOND3,
        "largest angular jerk; without it what the joints allow",
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

/// One cycle of a motion: its ports in the order of [`INPUTS`] and [`OUTPUTS`], its number, the width of `joints`.
pub(super) fn step(frame: &mut Frame<'_>, ports: [u32; PORTS], motion: u32, width: u32) {
    let [
        stop,
        pause,
        speed,
        joints,
        pose,
        done,
        progress,
        distance,
        speed_along,
        acceleration,
        leg,
    ] = ports;
    let drive = SpeedOverride {
        stop: frame.bool(stop) != 0,
        pause: frame.bool(pause) != 0,
        speed: frame.real(speed),
    };
    let Some(state) = frame.motions.step(motion as usize, drive) else {
        frame.motion_failed = true;
        frame.set_joints(joints, width, None);
        frame.set_reals(pose, [NULL_REAL; 7]);
        frame.set_bool(done, NULL_BOOL);
        for real in [progress, distance, speed_along, acceleration] {
            frame.set_real(real, NULL_REAL);
        }
        frame.set_int(leg, NULL_INT);
        return;
    };
    let known = state.joints.iter().all(|joint| joint.is_finite());
    frame.set_joints(joints, width, known.then_some(&state.joints));
    frame.set_pose(pose, state.pose);
    frame.set_bool(done, u8::from(state.path.done));
    frame.set_real(progress, state.progress);
    frame.set_real(distance, state.distance);
    frame.set_real(speed_along, state.speed);
    frame.set_real(acceleration, state.acceleration);
    frame.set_int(leg, i64::from(state.leg));
}
