//! Shared part of all motions along a path: inputs, outputs and the step of a cycle. Run by the real-time thread.

use crate::frame::{Frame, Preparation};
use crate::path::{ElbowMotion, SpeedOverride, SpeedProfile, leg_row};
use crate::primitive::{DefaultValue, Parameter, ParameterKind, Port, PortType, UnitRule};
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Type};
use crate::unit::Unit;

/// `stop`, `pause`, `speed`.
pub(super) const INPUTS: &[Port] = &[
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
        "acceleration of the flange along the path; negative while braking",
    )
    .diagnostic(),
    Port::int(
        "leg",
        "index of the current leg, from 0; a blend belongs to the leg before it",
    )
    .diagnostic(),
];

/// Number of operands for inputs and outputs.
pub(super) const PORTS: usize = 11;

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

/// The arm angle at the end.
pub(super) const ARM_ANGLE: Parameter = Parameter::new(
    "arm_angle",
    ParameterKind::Value(PortType::Is(Type::Real), UnitRule::RADIAN),
    "for seven joints: arm angle at the end, approached along the path by the shorter way; if omitted, `elbow` decides",
)
.default(DefaultValue::Null);

/// Motion of the elbow.
pub(super) const ELBOW: Parameter = Parameter::new(
    "elbow",
    ParameterKind::Word(leg_row::ELBOWS),
    "stays: keeps the arm angle of the start; middle: the elbow moves along the path to the middle of the range that the joint limits allow at the end",
)
.default(DefaultValue::Word("stays"));

/// Combines both parameters.
pub(super) fn elbow(preparation: &Preparation<'_>, [arm_angle, elbow]: [u32; 2]) -> ElbowMotion {
    let [arm_angle] = preparation.reals(arm_angle);
    leg_row::elbow(arm_angle, preparation.int(elbow) as f64)
}

/// Returns the speed profile that `time_optimal` selects.
pub(super) fn pace(preparation: &Preparation<'_>, slot: u32) -> SpeedProfile {
    match preparation.bool(slot) {
        1 => SpeedProfile::TimeOptimal,
        _ => SpeedProfile::Uniform,
    }
}

/// `velocity`, `acceleration`, `jerk` and the same for the orientation: limits of the flange. Null: limited only by the
/// joints.
pub(super) const FLANGE: [Parameter; 6] = [
    limit(
        "velocity",
        Unit::METRE_PER_SECOND,
        "speed along the path: guaranteed, or the motion is refused; if omitted, as fast as the joints allow",
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

/// Runs one cycle of a motion: its ports in the order of [`INPUTS`] and [`OUTPUTS`], its index, the width of `joints`.
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
    let speed_override = SpeedOverride {
        stop: frame.bool(stop) != 0,
        pause: frame.bool(pause) != 0,
        speed: frame.real(speed),
    };
    let Some(state) = frame.motions.step(motion as usize, speed_override) else {
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
