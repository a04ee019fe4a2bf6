//! `LinearMotion`: a straight Cartesian line, jerk-limited, that can be stopped on the path.
//!
//! Position is interpolated linearly, orientation by slerp, both by one path parameter s, which one clock drives from
//! rest to rest. A motion without `from` starts at the arm's hold set-point of the moment the command becomes ready;
//! START verifies that it is still there.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::{Drive, Leg, Limits, PathRequest, Segment};
use crate::pose::Pose;
use crate::primitive::{
    Entry, Kernel, Literal, NullRule, Parameter, ParameterKind, Port, PortType, Role, Spec,
    UnitRule, each,
};
use crate::types::{NULL_BOOL, NULL_REAL, Type};
use crate::unit::Unit;

const POSE: ParameterKind = ParameterKind::Value(PortType::Is(Type::Pose), UnitRule::Typed);

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "LinearMotion",
        summary: "A straight, jerk-limited line to a flange pose, with a soft stop on the path.",
        null: "a null `stop` counts as true: who cannot say that the motion may go on, stops it",
        null_rule: NullRule::Known,
        inputs: &[Port::bool(
            "stop",
            "brings the motion to rest on the path; once true, it stays stopped",
        )
        .default(Literal::Bool(false))],
        outputs: &[
            Port::typed(
                "pose",
                Type::Pose,
                "set-point of the flange in the arm's base",
            ),
            Port::bool("done", "at rest: at the end, or on the path after a stop"),
            Port::real(
                "distance",
                UnitRule::Is(Unit::METRE),
                "way along the line since the start",
            )
            .diagnostic(),
            Port::real(
                "speed",
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "speed along the line",
            )
            .diagnostic(),
            Port::real(
                "acceleration",
                UnitRule::Is(Unit::METRE_PER_SECOND2),
                "acceleration along the line",
            )
            .diagnostic(),
        ],
        parameters: &[
            Parameter::arm(),
            Parameter::new("to", POSE, "pose at the end, flange in the arm's base"),
            Parameter::new(
                "from",
                POSE,
                "pose at the start; without it the arm's hold set-point",
            )
            .default(Literal::Null),
            Parameter::real(
                "velocity",
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "largest speed along the line",
            )
            .above(0.0),
            Parameter::real(
                "acceleration",
                UnitRule::Is(Unit::METRE_PER_SECOND2),
                "largest acceleration along the line",
            )
            .above(0.0),
            Parameter::real(
                "jerk",
                UnitRule::Is(Unit::METRE_PER_SECOND3),
                "largest jerk along the line",
            )
            .above(0.0),
            Parameter::real(
                "angular_velocity",
                UnitRule::Is(Unit::RADIAN_PER_SECOND),
                "largest angular speed",
            )
            .default(Literal::Real(1.0))
            .above(0.0),
            Parameter::real(
                "angular_acceleration",
                UnitRule::Is(Unit::RADIAN_PER_SECOND2),
                "largest angular acceleration",
            )
            .default(Literal::Real(4.0))
            .above(0.0),
            Parameter::real(
                "angular_jerk",
                UnitRule::Is(Unit::RADIAN_PER_SECOND3),
                "largest angular jerk",
            )
            .default(Literal::Real(40.0))
            .above(0.0),
        ],
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
)
.prepared_by(prepare);

fn prepare(preparation: &mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault> {
    let &[.., device, to, from, v, a, j, w, wa, wj, motion] = operands else {
        return Ok(());
    };
    let from = Pose::from_slots(preparation.reals(from));
    let to = Pose::from_slots(preparation.reals(to));
    let [velocity, acceleration, jerk, w, wa, wj] = [v, a, j, w, wa, wj].map(|slot| {
        let [value] = preparation.reals(slot);
        value
    });
    let leg = Leg {
        line: Limits {
            velocity,
            acceleration,
            jerk,
        },
        turn: Limits {
            velocity: w,
            acceleration: wa,
            jerk: wj,
        },
        ..Leg::new(Segment::Line { to })
    };
    let request = PathRequest {
        device,
        from: from.is_finite().then_some(from),
        legs: &[leg],
        joints: false,
    };
    preparation.motions.path(motion, &request)
}

fn step(frame: &mut Frame<'_>, operands: [u32; 16]) {
    let [
        stop,
        pose,
        done,
        distance,
        speed,
        acceleration,
        _device,
        _to,
        _from,
        _,
        _,
        _,
        _,
        _,
        _,
        motion,
    ] = operands;
    let drive = Drive {
        stop: frame.bool(stop) != 0,
        ..Drive::RUN
    };
    let Some(state) = frame.motions.step(motion as usize, drive) else {
        frame.motion_failed = true;
        frame.set_reals(pose, [NULL_REAL; 7]);
        frame.set_bool(done, NULL_BOOL);
        frame.set_reals(distance, [NULL_REAL]);
        frame.set_reals(speed, [NULL_REAL]);
        frame.set_reals(acceleration, [NULL_REAL]);
        return;
    };
    frame.set_pose(pose, state.pose);
    frame.set_bool(done, u8::from(state.path.done));
    frame.set_real(distance, state.distance);
    frame.set_real(speed, state.speed);
    frame.set_real(acceleration, state.acceleration);
}

#[cfg(test)]
mod tests {
    use crate::testing::Bench;

    /// Lines themselves are tested where motions are built (rcc-motion).
    #[test]
    fn null_stops_it_like_true() {
        for stop in [None, Some(true)] {
            let mut bench = Bench::new("LinearMotion");
            bench.set_bool("stop", Some(false)).prepare().unwrap();
            assert_eq!(bench.step().bool("done"), Some(false));
            assert_eq!(bench.set_bool("stop", stop).step().bool("done"), Some(true));
        }
    }
}
