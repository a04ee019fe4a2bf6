//! `ScalarGoal`: moves one axis to a goal that may change in any cycle, as fast as limits of velocity, acceleration and
//! jerk allow.

use crate::axis::{AXIS_WORDS, AxisSlot, rest_at, share_of, step_axis};
use crate::frame::Frame;
use crate::path::MotionLimits;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, NullRule, Parameter, ParameterKind, Port,
    PortType, Real, Slot, Spec, StateSpec, Step, UnitRule, operands,
};
use crate::types::{NULL_BOOL, NULL_REAL, Type};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ScalarGoal",
        summary: "Moves to a goal that may change in any cycle, as fast as limits of velocity, acceleration and jerk allow.",
        null: "a null goal or `speed` brings the axis to rest and keeps it there, a null `stop` counts as true; null only until the first goal, if there is no `initial`",
        null_rule: NullRule::Remembers,
        undefined: "no goal yet and no `initial`",
        formula: "the time-optimal motion from any state to rest in phases of constant jerk: Berscheid and Kröger, Jerk-limited real-time trajectory generation with arbitrary target states, RSS 2021; from rest the double S of Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, 3.4",
        examples: &[
            Example::new(
                "a motion limited by jerk only: four phases of a second; starts at the first goal",
                "{velocity: 10, acceleration: 10, jerk: 6}",
                "goal | position | velocity | acceleration | done
                 0 | 0 | 0 | 0 | true
                 12 | 1 | 3 | 6 | false
                 12 | 6 | 6 | 0 | false
                 12 | 11 | 3 | -6 | false
                 12 | 12 | 0 | 0 | true
                 null | 12 | 0 | 0 | false",
            )
            .every_ms(1000),
            Example::new(
                "braked halfway, in two phases of a second; done at rest",
                "{velocity: 10, acceleration: 10, jerk: 6, initial: 0}",
                "goal | stop | position | velocity | done
                 12 | false | 1 | 3 | false
                 12 | false | 6 | 6 | false
                 12 | true | 11 | 3 | false
                 12 | true | 12 | 0 | true",
            )
            .every_ms(1000),
        ],
        inputs: &[
            Port::real("goal", UnitRule::Var(0), "goal"),
            Port::real(
                "speed",
                UnitRule::ONE,
                "fraction of the velocity limit to use; computed values above 1 count as 1, values below 0.0001 as 0 (a stop)",
            )
            .default(DefaultValue::Real(1.0)).within(0.0, 1.0),
            Port::bool("stop", "while true, it brakes to rest and stays there; afterwards it continues")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::real("position", UnitRule::Var(0), "set-point"),
            Port::real("velocity", UnitRule::PerSecond(0), "there").diagnostic(),
            Port::real("acceleration", UnitRule::PerSecond2(0), "there").diagnostic(),
            Port::bool("done", "at rest: at the goal, or where a stop ended"),
        ],
        parameters: &[
            Parameter::real("velocity", UnitRule::PerSecond(0), "largest speed").above(0.0),
            Parameter::real(
                "acceleration",
                UnitRule::PerSecond2(0),
                "largest acceleration, also for braking",
            )
            .above(0.0),
            Parameter::real("jerk", UnitRule::PerSecond3(0), "largest jerk").above(0.0),
            Parameter::new(
                "initial",
                ParameterKind::Value(PortType::Is(Type::Real), UnitRule::Var(0)),
                "start position, at rest; if omitted, the first goal",
            )
            .default(DefaultValue::Null),
        ],
        state: StateSpec {
            reals: AXIS_WORDS as u32,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<ScalarGoal>()],
);

operands! {
    struct ScalarGoal {
        goal: Slot<Real>, speed: Slot<Real>, stop: Slot<Bool>,
        position: Slot<Real>, velocity: Slot<Real>, acceleration: Slot<Real>, done: Slot<Bool>,
        max_velocity: Slot<Real>, max_acceleration: Slot<Real>, max_jerk: Slot<Real>, initial: Slot<Real>,
        state: AxisSlot,
    }
}

impl Step for ScalarGoal {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let share = share_of(frame, self.speed, self.stop)?;
        let stopped = frame.get(self.stop)? != 0;
        let goal = Some(frame.get(self.goal)?).filter(|goal| goal.is_finite());
        let [_, _, _, _, _, now, ..] = frame.get(self.state)?;
        if now.is_nan() {
            let initial = Some(frame.get(self.initial)?).filter(|initial| initial.is_finite());
            let begin = initial.or(goal).unwrap_or(NULL_REAL);
            frame.put(self.state, rest_at(begin))?;
        }
        let limits = MotionLimits {
            velocity: frame.get(self.max_velocity)? * share,
            acceleration: frame.get(self.max_acceleration)?,
            jerk: frame.get(self.max_jerk)?,
        };
        let axis = step_axis(frame, self.state, goal, &limits);
        let now = axis.map(|axis| axis.state());
        let at_rest = axis.map(|axis| axis.arrived() || stopped && axis.state().rests());
        frame.put(self.position, now.map_or(NULL_REAL, |now| now.position))?;
        frame.put(self.velocity, now.map_or(NULL_REAL, |now| now.velocity))?;
        frame.put(
            self.acceleration,
            now.map_or(NULL_REAL, |now| now.acceleration),
        )?;
        frame.put(self.done, at_rest.map_or(NULL_BOOL, u8::from))
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    fn bench() -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("ScalarGoal");
        for (name, value) in [("velocity", 0.5), ("acceleration", 2.0), ("jerk", 20.0)] {
            bench.set_real(name, value);
        }
        bench.set_real("speed", 1.0).set_bool("stop", Some(false));
        bench
    }

    #[test]
    fn starts_at_its_initial_position_or_at_the_first_goal() {
        let mut first = bench();
        assert!(first.step().real("position").is_nan());
        assert_eq!(first.bool("done"), None);
        assert_eq!(first.set_real("goal", 0.7).step().real("position"), 0.7);
        let mut given = bench();
        given.set_real("initial", 0.2).set_real("goal", 0.7);
        assert!((given.step().real("position") - 0.2).abs() < 1e-6);
    }

    #[test]
    fn a_null_goal_speed_or_stop_brakes_and_a_known_one_continues() {
        for (port, known) in [("goal", 1.0), ("speed", 1.0), ("stop", 0.0)] {
            let mut bench = bench();
            bench.set_real("initial", 0.0).set_real("goal", 1.0);
            (0..500).for_each(|_| _ = bench.step());
            match port {
                "stop" => bench.set_bool("stop", None),
                real => bench.set_real(real, f64::NAN),
            };
            (0..800).for_each(|_| _ = bench.step());
            assert_eq!(bench.real("velocity"), 0.0, "{port}");
            assert_eq!(bench.bool("done"), Some(port == "stop"), "{port}");
            match port {
                "stop" => bench.set_bool("stop", Some(false)),
                real => bench.set_real(real, known),
            };
            (0..4000).for_each(|_| _ = bench.step());
            assert_eq!(bench.real("position"), 1.0, "{port}");
            assert_eq!(bench.bool("done"), Some(true), "{port}");
        }
    }
}
