//! `OnlineTrajectory`: follows a goal that may jump or move, as fast as limits of velocity and acceleration allow, and
//! arrives without overshoot. Time-optimal in discrete time, in closed form: no search, no iteration.
//!
//! With e the remaining distance, relative to the moving goal, and a dt² as its unit, z = (e - dt · v / 2) / (a dt²).
//! The velocity from which the goal can just be reached by braking with a is a dt (|z| / m + (m - 1) / 2), with m the
//! number of cycles that braking takes; the next velocity is the nearest to it that the limits allow.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Kernel, NullRule, Port, Real, Slot, Spec,
    StateSpec, Step, UnitRule, operands, within,
};
use crate::types::{NULL_BOOL, NULL_REAL};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "OnlineTrajectory",
        summary: "Follows a goal as fast as limits of velocity and acceleration allow, without overshoot.",
        null: "a null input gives null and stops: the trajectory then continues from the last position, at rest; `reset_to` may be null",
        null_rule: NullRule::Propagates,
        undefined: "a limit that is not above 0; overflow",
        formula: "the discrete-time second-order filter of Zanasi, Bianco and Tonielli, Nonlinear filters for the generation \
                  of smooth trajectories, Automatica 36 (2000); Biagiotti and Melchiorri, Trajectory Planning for Automatic \
                  Machines and Robots, 2008, 4.6.2; position by the trapezoidal rule",
        examples: &[
            Example::new(
                "from 0 to 4 and back to 3, one cycle per second; starts at the first goal",
                "",
                "goal | max_velocity | max_acceleration | position | velocity
                 0 | 2 | 1 | 0 | 0
                 4 | 2 | 1 | 0.5 | 1
                 4 | 2 | 1 | 2 | 2
                 4 | 2 | 1 | 3.5 | 1
                 4 | 2 | 1 | 4 | 0
                 4 | 2 | 1 | 4 | 0
                 3 | 2 | 1 | 3.5 | -1
                 3 | 2 | 1 | 3 | 0",
            )
            .every_ms(1000),
            Example::new(
                "a moving goal is followed without lag",
                "",
                "goal | goal_velocity | max_velocity | max_acceleration | position | velocity
                 0 | 1 | 2 | 1 | 0 | 0
                 1 | 1 | 2 | 1 | 0.5 | 1
                 2 | 1 | 2 | 1 | 1.75 | 1.5
                 3 | 1 | 2 | 1 | 3 | 1
                 4 | 1 | 2 | 1 | 4 | 1",
            )
            .every_ms(1000),
        ],
        inputs: &[
            Port::real("goal", UnitRule::Var(0), "goal"),
            Port::real(
                "goal_velocity",
                UnitRule::PerSecond(0),
                "velocity of the goal",
            )
            .default(DefaultValue::Real(0.0)),
            Port::real(
                "max_velocity",
                UnitRule::PerSecond(0),
                "velocity limit; when it is lowered, the velocity follows as the acceleration allows",
            ),
            Port::real(
                "max_acceleration",
                UnitRule::PerSecond2(0),
                "acceleration limit, also for braking",
            ),
            Port::bool("reset", "while true, the position is `reset_to`, at rest")
                .default(DefaultValue::Bool(false)),
            Port::real(
                "reset_to",
                UnitRule::Var(0),
                "position at the start and after a reset; null: at the goal",
            )
            .default(DefaultValue::Null),
        ],
        outputs: &[
            Port::real("position", UnitRule::Var(0), "set-point"),
            Port::real(
                "velocity",
                UnitRule::PerSecond(0),
                "velocity at this position",
            )
            .diagnostic(),
            Port::real(
                "acceleration",
                UnitRule::PerSecond2(0),
                "acceleration in the period that led to this position",
            )
            .diagnostic(),
        ],
        // position, velocity
        state: StateSpec {
            reals: 2,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<OnlineTrajectory>()],
);

operands! {
    struct OnlineTrajectory {
        goal: Slot<Real>, goal_velocity: Slot<Real>, max_velocity: Slot<Real>, max_acceleration: Slot<Real>,
        reset: Slot<Bool>, reset_to: Slot<Real>,
        position: Slot<Real>, velocity: Slot<Real>, acceleration: Slot<Real>, state: Slot<[Real; 2]>,
    }
}

impl Step for OnlineTrajectory {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (goal, goal_velocity) = (frame.get(self.goal)?, frame.get(self.goal_velocity)?);
        let (most, acceleration) = (
            frame.get(self.max_velocity)?,
            frame.get(self.max_acceleration)?,
        );
        let (reset, reset_to) = (frame.get(self.reset)?, frame.get(self.reset_to)?);
        let ([position, velocity], dt_s) = (frame.get(self.state)?, frame.dt_s);
        let begins = (reset == 1) | position.is_nan();
        let (now, speed) = if begins {
            (if reset_to.is_nan() { goal } else { reset_to }, 0.0)
        } else {
            // The goal has its current position now, so one cycle ago it was behind by its velocity.
            let left = goal - goal_velocity * dt_s - position;
            let relative = braking_speed(left, velocity - goal_velocity, acceleration, dt_s);
            let wanted = within(goal_velocity + relative, -most, most);
            let change = acceleration * dt_s;
            let speed = within(wanted, velocity - change, velocity + change);
            (position + (velocity + speed) / 2.0 * dt_s, speed)
        };
        let known = (reset & NULL_BOOL == 0) & (most > 0.0) & (acceleration > 0.0);
        let known = known
            & [goal, goal_velocity, acceleration, most, now, speed]
                .iter()
                .all(|value| value.is_finite());
        let rate = if begins {
            0.0
        } else {
            (speed - velocity) / dt_s
        };
        let results = if known {
            [now, speed, rate]
        } else {
            [NULL_REAL; 3]
        };
        for (slot, value) in [self.position, self.velocity, self.acceleration]
            .into_iter()
            .zip(results)
        {
            frame.put(slot, value)?;
        }
        frame.put(
            self.state,
            if known { [now, speed] } else { [position, 0.0] },
        )
    }
}

/// Returns the velocity towards a goal at rest after one more period, from which braking with `acceleration` ends
/// exactly at the goal: `left` is the distance to it and `velocity` the current velocity. Infinite for a distance that
/// overflows, so that the limits decide.
#[inline(always)]
fn braking_speed(left: f64, velocity: f64, acceleration: f64, dt_s: f64) -> f64 {
    let unit = acceleration * dt_s;
    let z = (left / dt_s - velocity / 2.0) / unit;
    let size = z.abs();
    let cycles = libm::floor((1.0 + libm::sqrt(1.0 + 8.0 * size)) / 2.0);
    let speed = if cycles.is_infinite() {
        cycles
    } else {
        unit * (size / cycles + (cycles - 1.0) / 2.0)
    };
    if z < 0.0 { -speed } else { speed }
}

#[cfg(test)]
mod tests {
    use rcc_testing::{Random, Rng};

    use crate::testing::PrimitiveHarness;

    const DT_S: f64 = 1e-3;

    fn bench(velocity: f64, acceleration: f64) -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("OnlineTrajectory");
        bench
            .set_real("goal_velocity", 0.0)
            .set_real("max_velocity", velocity)
            .set_real("max_acceleration", acceleration)
            .set_bool("reset", Some(false));
        bench
    }

    /// Runs one cycle and checks the limits and the consistency of position and velocity.
    fn checked_step(
        bench: &mut PrimitiveHarness,
        last: &mut [f64; 2],
        velocity: f64,
        acceleration: f64,
    ) {
        bench.step();
        let [position, speed] = [bench.real("position"), bench.real("velocity")];
        let rate = (speed - last[1]) / DT_S;
        assert!(rate.abs() <= acceleration * (1.0 + 1e-9) + 1e-9, "{rate}");
        assert!((bench.real("acceleration") - rate).abs() < 1e-9 * acceleration);
        assert!(speed.abs() <= velocity * (1.0 + 1e-9), "{speed}");
        let moved = (speed + last[1]) / 2.0 * DT_S;
        assert!((position - last[0] - moved).abs() < 1e-12, "{position}");
        *last = [position, speed];
    }

    #[test]
    fn goals_that_jump_at_any_time_break_no_limit() {
        for seed in 1..20 {
            let mut rng = Rng::with_seed(seed);
            let mut random = || rng.uniform(-1.0, 1.0);
            let (velocity, acceleration) = (0.5 + 0.4 * random(), 5.0 + 4.0 * random());
            let mut bench = bench(velocity, acceleration);
            let mut last = [0.0; 2];
            bench.set_real("goal", 0.0).step();
            for _ in 0..60 {
                for _ in 0..(500.0 * random().abs()) as usize {
                    checked_step(&mut bench, &mut last, velocity, acceleration);
                }
                bench.set_real("goal", random());
            }
        }
    }

    #[test]
    fn it_arrives_as_early_as_the_limits_allow_and_not_beyond() {
        // Duration of the fastest motion (Biagiotti and Melchiorri 2008, 3.2): with and without a phase at constant
        // velocity.
        for (distance, velocity, acceleration) in [
            (0.3, 0.5, 4.0),
            (-0.02, 0.5, 4.0),
            (1e-5, 0.5, 4.0),
            (2.0, 1.0, 10.0),
        ] {
            let mut bench = bench(velocity, acceleration);
            bench.set_real("goal", 0.0).step();
            bench.set_real("goal", distance);
            let size = f64::abs(distance);
            let fastest_s = if size >= velocity * velocity / acceleration {
                size / velocity + velocity / acceleration
            } else {
                2.0 * f64::sqrt(size / acceleration)
            };
            let mut last = [0.0; 2];
            let mut cycles = 0;
            while (last[0] - distance).abs() > 1e-12 || last[1].abs() > 1e-9 {
                checked_step(&mut bench, &mut last, velocity, acceleration);
                assert!(last[0].abs() <= size + 1e-12, "beyond: {}", last[0]);
                cycles += 1;
                assert!(
                    f64::from(cycles) * DT_S <= fastest_s + 2.0 * DT_S,
                    "{distance}: late"
                );
            }
            assert!(
                f64::from(cycles) * DT_S >= fastest_s - 1e-9,
                "{distance}: {cycles}"
            );
        }
    }

    #[test]
    fn a_moving_goal_is_reached_and_followed() {
        let (mut bench, mut last) = (bench(0.5, 2.0), [0.0; 2]);
        bench.set_real("goal_velocity", 0.2);
        bench.set_real("goal", 0.0).step();
        for cycle in 1..3000 {
            let goal = 0.1 + 0.2 * f64::from(cycle) * DT_S;
            bench.set_real("goal", goal);
            checked_step(&mut bench, &mut last, 0.5, 2.0);
            if cycle > 1000 {
                assert!(
                    (last[0] - goal).abs() < 1e-9 && (last[1] - 0.2).abs() < 1e-6,
                    "{cycle}: {last:?}"
                );
            }
        }
    }

    #[test]
    fn a_velocity_above_a_new_limit_decreases_as_the_acceleration_allows() {
        let (mut bench, mut last) = (bench(1.0, 2.0), [0.0; 2]);
        bench.set_real("goal", 0.0).step();
        bench.set_real("goal", 10.0);
        for _ in 0..600 {
            checked_step(&mut bench, &mut last, 1.0, 2.0);
        }
        assert_eq!(last[1], 1.0);
        bench.set_real("max_velocity", 0.5);
        for _ in 0..250 {
            checked_step(&mut bench, &mut last, 1.0, 2.0);
        }
        assert!((last[1] - 0.5).abs() < 1e-9);
    }

    #[test]
    fn starts_and_is_reset_at_the_given_position() {
        let mut bench = bench(0.5, 2.0);
        bench.set_real("reset_to", 0.7).set_real("goal", 1.0);
        assert_eq!(bench.step().real("position"), 0.7);
        assert!(bench.step().real("position") > 0.7);
        assert!(
            bench
                .set_real("goal", f64::NAN)
                .step()
                .real("position")
                .is_nan()
        );
        let resting = bench.set_real("goal", 1.0).step().real("velocity");
        assert!(
            (resting - 2.0 * DT_S).abs() < 1e-12,
            "from rest again: {resting}"
        );
        assert_eq!(
            bench.set_bool("reset", Some(true)).step().real("position"),
            0.7
        );
        for (limit, value) in [("max_velocity", 0.0), ("max_acceleration", -1.0)] {
            let before = bench.real(limit);
            assert!(
                bench
                    .set_real(limit, value)
                    .step()
                    .real("position")
                    .is_nan(),
                "{limit}"
            );
            bench.set_real(limit, before);
        }
    }
}
