//! `LinearMotion`: a straight Cartesian line, jerk-limited, that can be stopped on the path.
//!
//! Position is interpolated linearly, orientation by slerp, both by one path parameter s, which a
//! 1-DoF jerk-limited profile drives from 0 to the length of the path. s is in metres if the line
//! decides the speed and in radians if the rotation does, so that the limits of both hold. A motion
//! without `from` starts at the arm's hold set-point of the moment the command becomes ready; START
//! verifies that it is still there.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::PathLimits;
use crate::pose::Pose;
use crate::primitive::{
    Entry, Kernel, Literal, NullRule, Parameter, ParameterKind, Port, PortType, Role, Spec, State,
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
        // start pose (7), length of the path in s, metres per unit of s
        state: State {
            reals: 9,
            ..State::NONE
        },
        role: Role::Motion,
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
)
.prepared_by(prepare);

/// Below this a line has no length and a rotation no angle (m, rad).
const NOTHING: f64 = 1e-9;

fn prepare(preparation: &mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault> {
    let &[
        _stop,
        _pose,
        _done,
        _distance,
        _speed,
        _acceleration,
        device,
        to,
        from,
        v,
        a,
        j,
        w,
        wa,
        wj,
        state,
        clock,
    ] = operands
    else {
        return Ok(());
    };
    let given = Pose::from_slots(preparation.reals(from));
    let start = if given.is_finite() {
        given
    } else {
        let (arm, hold) = preparation.arm_at_rest(device)?;
        arm.forward(&hold)
    };
    let goal = Pose::from_slots(preparation.reals(to));
    start
        .slerp(&goal, 0.5)
        .ok_or(PrepareFault::AmbiguousRotation)?;
    let [v, a, j, w, wa, wj] = [v, a, j, w, wa, wj].map(|slot| {
        let [value] = preparation.reals(slot);
        value
    });
    let line_m = start.distance_to(&goal);
    let angle_rad = start.angle_to(&goal);
    let (line, turn) = ([v, a, j], [w, wa, wj]);
    let by_line = line_m > NOTHING && line_m * w >= angle_rad * v;
    let length = if by_line { line_m } else { angle_rad };
    let limits = match (by_line, length > NOTHING) {
        (_, false) => line,
        (true, true) => tighter(line, turn, angle_rad / line_m),
        (false, true) => tighter(turn, line, line_m / angle_rad),
    };
    let [velocity, acceleration, jerk] = limits;
    let length = if length > NOTHING { length } else { 0.0 };
    let limits = PathLimits {
        length,
        velocity,
        acceleration,
        jerk,
    };
    *preparation
        .paths
        .get_mut(clock as usize)
        .ok_or(PrepareFault::PathLimits { limits })? = limits;
    preparation.set_reals(state, start.to_slots());
    let metres_per_s = if length > 0.0 { line_m / length } else { 0.0 };
    preparation.set_reals(state + 7, [length, metres_per_s]);
    Ok(())
}

/// Limits of the leading quantity such that `ratio` times it keeps the limits of the following one.
fn tighter(leading: [f64; 3], following: [f64; 3], ratio: f64) -> [f64; 3] {
    let ([a, b, c], [x, y, z]) = (leading, following);
    let limit = |leading: f64, following: f64| {
        if ratio > 0.0 {
            leading.min(following / ratio)
        } else {
            leading
        }
    };
    [limit(a, x), limit(b, y), limit(c, z)]
}

fn step(frame: &mut Frame<'_>, operands: [u32; 17]) {
    let [
        stop,
        pose,
        done,
        distance,
        speed,
        acceleration,
        _device,
        to,
        _from,
        _,
        _,
        _,
        _,
        _,
        _,
        state,
        clock,
    ] = operands;
    let stop = frame.bool(stop) != 0;
    let [length, metres_per_s] = frame.reals(state + 7);
    let Some(path) = frame.clocks.step(clock as usize, stop) else {
        frame.motion_failed = true;
        frame.set_reals(pose, [NULL_REAL; 7]);
        frame.set_bool(done, NULL_BOOL);
        frame.set_reals(distance, [NULL_REAL]);
        frame.set_reals(speed, [NULL_REAL]);
        frame.set_reals(acceleration, [NULL_REAL]);
        return;
    };
    let (start, goal) = (Pose::from_slots(frame.reals(state)), frame.pose(to));
    let fraction = if length > 0.0 { path.s / length } else { 0.0 };
    let at = start
        .slerp(&goal, fraction)
        .unwrap_or(Pose::from_slots([NULL_REAL; 7]));
    frame.set_pose(pose, at);
    frame.set_bool(done, u8::from(path.done));
    frame.set_real(distance, path.s * metres_per_s);
    frame.set_real(speed, path.velocity * metres_per_s);
    frame.set_real(acceleration, path.acceleration * metres_per_s);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Bench;

    fn bench(to: Pose) -> Bench {
        let mut bench = Bench::new("LinearMotion");
        bench.hold = Some([0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0]);
        let values = [("velocity", 0.2), ("acceleration", 1.0), ("jerk", 10.0)];
        let turns = [
            ("angular_velocity", 1.0),
            ("angular_acceleration", 4.0),
            ("angular_jerk", 40.0),
        ];
        for (name, value) in values.into_iter().chain(turns) {
            bench.set_real(name, value);
        }
        bench
            .set_reals("to", &to.to_slots())
            .set_bool("stop", Some(false));
        bench
    }

    fn start(bench: &Bench) -> Pose {
        let hold = bench.hold.unwrap();
        bench
            .model
            .arm
            .unwrap()
            .forward(&hold[..7].try_into().unwrap())
    }

    fn pose(bench: &Bench) -> Pose {
        Pose::from_slots(bench.reals("pose", 7).try_into().unwrap())
    }

    #[test]
    fn begins_at_the_hold_set_point_and_stays_on_the_line() {
        let mut bench = bench(Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.0, 0.0]));
        bench.prepare().unwrap();
        let from = start(&bench);
        let to = Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.0, 0.0]);
        assert!(pose(bench.step()).distance_to(&from) < 1e-12);
        let whole = from.distance_to(&to);
        for _ in 0..500 {
            let at = pose(bench.step());
            let fraction = bench.real("distance") / whole;
            for ((at, from), to) in at.position.iter().zip(from.position).zip(to.position) {
                assert!((at - (from + fraction * (to - from))).abs() < 1e-12);
            }
        }
        assert!(bench.real("distance") > 0.01);
    }

    #[test]
    fn null_stops_it_like_true() {
        for stop in [None, Some(true)] {
            let mut bench = bench(Pose::from_xyz_rpy([0.4, 0.1, 0.5], [3.0, 0.0, 0.0]));
            bench.prepare().unwrap();
            assert_eq!(bench.step().bool("done"), Some(false));
            assert_eq!(bench.set_bool("stop", stop).step().bool("done"), Some(true));
        }
    }

    #[test]
    fn a_motion_to_where_the_arm_is_has_no_length() {
        let mut bench = bench(Pose::from_slots([0.0; 7]));
        let here = start(&bench);
        bench.set_reals("to", &here.to_slots());
        bench.prepare().unwrap();
        assert_eq!(bench.step().bool("done"), Some(true));
        assert!(pose(&bench).distance_to(&here) < 1e-12);
    }

    #[test]
    fn the_limits_of_line_and_rotation_both_hold() {
        for (turn, by) in [(0.01, "line"), (2.5, "rotation")] {
            let mut bench = bench(Pose::from_slots([0.0; 7]));
            let from = start(&bench);
            let goal = from.compose(&Pose::from_xyz_rpy([0.1, 0.0, 0.0], [turn, 0.0, 0.0]));
            bench.set_reals("to", &goal.to_slots());
            bench.prepare().unwrap();
            let (first, second) = (pose(bench.step()), pose(bench.step()));
            assert!(first.distance_to(&second) <= 0.2e-3 * (1.0 + 1e-9), "{by}");
            assert!(first.angle_to(&second) <= 1e-3 * (1.0 + 1e-9), "{by}");
        }
    }

    #[test]
    fn turning_by_half_a_turn_is_refused() {
        let mut bench = bench(Pose::from_slots([0.0; 7]));
        let from = start(&bench);
        let goal = from.compose(&Pose::from_xyz_rpy(
            [0.1, 0.0, 0.0],
            [core::f64::consts::PI, 0.0, 0.0],
        ));
        bench.set_reals("to", &goal.to_slots());
        assert_eq!(bench.prepare(), Err(PrepareFault::AmbiguousRotation));
    }
}
