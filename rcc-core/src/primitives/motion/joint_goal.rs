//! `JointGoal`: moves the joints of an arm to a goal that may change in any cycle, each as fast as its limits allow, or all so
//! that they arrive together.
//!
//! The path in between is unspecified, also with `synchronize: time`. Use a motion along a path where the path matters.
//!
//! Cost for seven joints, measured on a loaded virtual machine with two cores: 0.6 µs in a cycle without changes; 13 µs
//! (median) and 29 µs (99th percentile) in a cycle in which all goals change. Every loop has a constant bound: each
//! joint is planned at most once per cycle, with two evaluations of the closed forms (`docs/performance-motion.md`), and
//! with `synchronize: time` at most three times more for a given duration: 28 µs (median) and 83 µs (99th percentile).

use crate::axis::{
    AXIS_WORDS, AxisFollower, AxisSlot, AxisState, AxisTask, Phases, axes, continued, is_new,
    rest_at, share_of, step_axis,
};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::joints::{JOINTS_MAX, Joints};
use crate::path::MotionLimits;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Device, Int, Kernel, NullRule, Parameter, ParameterKind,
    Port, PortType, Prepare, Real, Slot, Spec, StateSpec, Step, UnitRule, operands,
};
use crate::primitives::start;
use crate::types::{NULL_BOOL, NULL_REAL, Type};

/// Optional limit for all joints.
const fn limit(name: &'static str, order: u8, doc: &'static str) -> Parameter {
    let value = ParameterKind::Value(PortType::Is(Type::Real), UnitRule::Joint(order));
    Parameter::new(name, value, doc)
        .default(DefaultValue::Null)
        .above(0.0)
}

/// Words of `synchronize`, by their numbers.
const SYNCHRONIZATIONS: &[&str] = &["none", "time"];
/// Index of `time` in [`SYNCHRONIZATIONS`].
const TIME: i64 = 1;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "JointGoal",
        summary: "Moves joints to a goal that may change in any cycle, each as fast as its limits of velocity, acceleration and jerk allow, or all in the same time.",
        null: "a null element of `goal` or a null `speed` brings all joints to rest and keeps them there; a null `stop` counts \
               as true",
        null_rule: NullRule::Known,
        formula: "each joint independently, as ScalarGoal, or with `synchronize: time` in the time of the slowest one: from rest \
                  with its velocity scaled by k = own time / that time, its acceleration by k², its jerk by k³; in the first cycle \
                  it is at rest at the arm's hold set-point, or where `start: continue` begins",
        inputs: &[
            Port::new(
                "goal",
                PortType::Joints,
                UnitRule::Joint(0),
                "goal, A1 first; counts as null if an element is outside its joint's range",
            ),
            Port::real(
                "speed",
                UnitRule::ONE,
                "fraction of the velocity limit to use; computed values above 1 count as 1, values below 0.0001 as 0 (a stop)",
            )
            .default(DefaultValue::Real(1.0)).within(0.0, 1.0),
            Port::bool("stop", "while true, all joints brake to rest and stay there; afterwards they continue")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::new(
                "position",
                PortType::Joints,
                UnitRule::Joint(0),
                "set-point, A1 first",
            ),
            Port::new(
                "velocity",
                PortType::Joints,
                UnitRule::Joint(1),
                "there",
            )
            .diagnostic(),
            Port::bool("done", "all joints are at rest: at the goal, or where a stop ended"),
            Port::bool("accepted", "the goal is known and within the range of every joint")
                .diagnostic(),
        ],
        parameters: &[
            Parameter::arm(),
            Parameter::real(
                "scale",
                UnitRule::ONE,
                "fraction of the velocity, acceleration and jerk limits of the robot's configuration to use",
            )
            .default(DefaultValue::Real(1.0))
            .above(0.0)
            .at_most(1.0),
            limit(
                "velocity",
                1,
                "velocity limit of every joint, if lower than the configured one",
            ),
            limit(
                "acceleration",
                2,
                "acceleration limit of every joint, if lower than the configured one",
            ),
            limit(
                "jerk",
                3,
                "jerk limit of every joint, if lower than the configured one",
            ),
            start::parameter(
                "hold: begins at rest where the arm is held at LOAD or START; continue: begins from position, velocity and \
                 acceleration that the net leaves from which a hand-over or a rule takes the arm, and otherwise where the arm is held",
            ),
            Parameter::new(
                "synchronize",
                ParameterKind::Word(SYNCHRONIZATIONS),
                "none: each joint arrives as soon as it can; time: all arrive together, from rest when the slowest can, in motion \
                 later if a joint cannot take exactly so long; a stop brakes each joint as fast as it can",
            )
            .default(DefaultValue::Word("none")),
        ],
        state: StateSpec {
            reals: (JOINTS_MAX * AXIS_WORDS) as u32,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<JointGoal>()],
)
.prepared_by::<JointGoal>();

operands! {
    struct JointGoal {
        goal: Slot<Real>, speed: Slot<Real>, stop: Slot<Bool>,
        position: Slot<Real>, velocity: Slot<Real>, done: Slot<Bool>, accepted: Slot<Bool>,
        device: Device, scale: Slot<Real>, max_velocity: Slot<Real>, max_acceleration: Slot<Real>,
        max_jerk: Slot<Real>, start: Slot<Int>, synchronize: Slot<Int>, state: AxisSlot, width: u32,
    }
}

impl Prepare for JointGoal {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let device = self.device.0;
        let hold = preparation.holds.get(device as usize).copied().flatten();
        let hold = hold.ok_or(PrepareFault::HoldUnknown { device })?;
        for (position, slot) in hold.into_iter().zip(self.axes()) {
            preparation.put(slot, rest_at(position));
        }
        Ok(())
    }
}

impl JointGoal {
    /// In the first cycle with `start: continue`, begins from the motion that the arm is in.
    fn take_over(self, frame: &mut Frame<'_>) -> Option<()> {
        let Some(motion) = start::taken_over(frame, self.device, self.start)? else {
            return Some(());
        };
        let rates = motion.velocity.into_iter().zip(motion.acceleration);
        let states = motion.position.into_iter().zip(rates);
        for ((position, (velocity, acceleration)), slot) in states.zip(self.axes()) {
            let state = AxisState {
                position,
                velocity,
                acceleration,
            };
            frame.put(slot, continued(state))?;
        }
        Some(())
    }

    /// Begins motions that end together if one of them would be planned now; while a joint is not known or has no goal
    /// within its reach, each acts by itself.
    fn plan_together(
        self,
        frame: &mut Frame<'_>,
        goal: &Joints,
        limits: &[MotionLimits; JOINTS_MAX],
    ) -> Option<()> {
        let width = self.width as usize;
        let mut followers = [AxisFollower::at_rest(0.0); JOINTS_MAX];
        let mut tasks = [AxisTask::NONE; JOINTS_MAX];
        let mut changed = false;
        let wanted = goal.iter().zip(limits).zip(self.axes());
        let places = followers.iter_mut().zip(&mut tasks).take(width);
        for ((follower, task), ((goal, limits), slot)) in places.zip(wanted) {
            *follower = AxisFollower::from_words(&frame.get(slot)?);
            let from = follower.state();
            let Some(plans) = follower.plans(*goal, limits).filter(|_| from.is_finite()) else {
                return Some(());
            };
            let (goal, limits) = (*goal, *limits);
            *task = AxisTask { from, goal, limits };
            changed |= plans;
        }
        if !changed {
            return Some(());
        }
        let mut ways = [Phases::default(); JOINTS_MAX];
        let tasks = tasks.get(..width)?;
        frame.motions.plan_axes(tasks, &mut ways);
        let planned = tasks.iter().zip(&mut followers).zip(ways);
        for (((task, follower), way), slot) in planned.zip(self.axes()) {
            follower.begin(task.goal, &task.limits, way);
            frame.put(slot, follower.words())?;
        }
        Some(())
    }

    fn axes(self) -> impl Iterator<Item = AxisSlot> {
        axes(self.state, JOINTS_MAX as u32)
    }
}

impl Step for JointGoal {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let width = self.width as usize;
        let robot = frame.models.get(self.device.0 as usize)?.limits;
        let share = share_of(frame, self.speed, self.stop)?;
        let stopped = frame.get(self.stop)? != 0;
        let scale = frame.get(self.scale)?;
        let given = [
            frame.get(self.max_velocity)?,
            frame.get(self.max_acceleration)?,
            frame.get(self.max_jerk)?,
        ];
        let inside = |goal: &Joints| {
            let ranges = robot.lower.iter().zip(&robot.upper);
            let mut joints = goal.iter().zip(ranges).take(width);
            joints.all(|(goal, (lower, upper))| lower <= goal && goal <= upper)
        };
        self.take_over(frame)?;
        let goal = frame.joints(self.goal, self.width).filter(inside);
        let mut new = self.axes().take(width).map(|slot| is_new(frame, slot));
        let begins = new.try_fold(true, |all, new| Some(all && new?))?;
        let rows = robot.velocity_max.iter().zip(&robot.acceleration_max);
        let rows = rows.zip(&robot.jerk_max);
        let mut bounds = [MotionLimits::NONE; JOINTS_MAX];
        for (bounds, ((v, a), j)) in bounds.iter_mut().zip(rows) {
            *bounds = limits([*v, *a, *j], scale, given, share);
        }
        let aim = goal.filter(|_| !begins);
        if let Some(aim) = aim.filter(|_| share > 0.0)
            && frame.get(self.synchronize)? == TIME
        {
            self.plan_together(frame, &aim, &bounds)?;
        }
        let (mut positions, mut velocities) = ([NULL_REAL; JOINTS_MAX], [NULL_REAL; JOINTS_MAX]);
        let (mut known, mut there, mut rests) = (true, true, true);
        let places = positions.iter_mut().zip(&mut velocities).enumerate();
        let axes = bounds.iter().zip(self.axes());
        for ((joint, places), (limits, slot)) in places.zip(axes).take(width) {
            let aim = aim.and_then(|aim| aim.get(joint).copied());
            let axis = step_axis(frame, slot, aim, limits);
            known &= axis.is_some();
            if let Some(now) = axis.as_ref().map(AxisFollower::state) {
                (*places.0, *places.1) = (now.position, now.velocity);
                rests &= now.rests();
            }
            there &= axis.is_some_and(|axis| axis.arrived());
        }
        frame.put_joints(
            self.position,
            self.width,
            Some(&positions).filter(|_| known),
        )?;
        frame.put_joints(
            self.velocity,
            self.width,
            Some(&velocities).filter(|_| known),
        )?;
        let at_rest = u8::from(there || stopped && rests);
        frame.put(self.done, if known { at_rest } else { NULL_BOOL })?;
        frame.put(self.accepted, u8::from(goal.is_some()))
    }
}

/// Returns the limits of one joint: the robot's, scaled, or the given ones if they are lower.
fn limits(robot: [f64; 3], scale: f64, given: [f64; 3], share: f64) -> MotionLimits {
    let [robot_v, robot_a, robot_j] = robot;
    let [v, a, j] = given;
    let least = |robot: f64, given: f64| {
        let scaled = robot * scale;
        if given < scaled { given } else { scaled }
    };
    MotionLimits {
        velocity: least(robot_v, v) * share,
        acceleration: least(robot_a, a),
        jerk: least(robot_j, j),
    }
}

#[cfg(test)]
mod tests {
    use crate::frame::PrepareFault;
    use crate::joints::ArmMotion;
    use crate::testing::PrimitiveHarness;

    const HOLD: [f64; 7] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4];
    const GOAL: [f64; 7] = [0.5, 0.3, -0.2, -1.0, 0.2, 1.1, 0.0];

    fn bench() -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("JointGoal");
        bench.hold = Some([0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0]);
        bench.set_real("speed", 1.0).set_real("scale", 1.0);
        bench.set_reals("goal", &GOAL).set_bool("stop", Some(false));
        bench.prepare().unwrap();
        bench
    }

    #[test]
    fn continues_a_motion_from_its_position_velocity_and_acceleration() {
        for goal in [Some(GOAL), None] {
            let mut bench = bench();
            bench.set_int("start", super::start::CONTINUE);
            if goal.is_none() {
                bench.set_bool("stop", Some(true));
            }
            let mut motion = ArmMotion::at_rest([0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0]);
            (motion.velocity[0], motion.acceleration[0]) = (0.8, 1.5);
            bench.arm = Some(motion);
            let (mut last, mut speed) = (0.3, 0.8 - 0.5e-3 * 1.5);
            let limit = bench.model.limits.acceleration_max[0];
            for _ in 0..5000 {
                bench.step();
                let now = bench.reals("position", 7)[0];
                let velocity = (now - last) / 1e-3;
                // The robot's limit of acceleration, and the rounding of two differences.
                assert!((velocity - speed).abs() <= limit * 1e-3 * (1.0 + 1e-6) + 1e-9);
                (last, speed) = (now, velocity);
            }
            assert_eq!(bench.bool("done"), Some(true));
            match goal {
                Some(goal) => assert_eq!(last, goal[0]),
                // It cannot stop sooner than at the full deceleration.
                None => assert!(last > 0.3 + 0.8 * 0.8 / (2.0 * limit), "{last}"),
            }
        }
    }

    #[test]
    fn goes_from_the_hold_set_point_to_the_goal_within_the_robot_s_limits() {
        let (mut bench, mut last) = (bench(), HOLD);
        for _ in 0..3000 {
            bench.step();
            for (last, now) in last.iter_mut().zip(bench.reals("position", 7)) {
                assert!((now - *last).abs() <= 2.0 * 1e-3 * (1.0 + 1e-9));
                *last = *now;
            }
        }
        assert_eq!((last, bench.bool("done")), (GOAL, Some(true)));
    }

    /// The cycle in which each joint first rests at its goal.
    fn arrivals(bench: &mut PrimitiveHarness, goal: &[f64; 7]) -> [usize; 7] {
        let mut arrived = [None; 7];
        for cycle in 0..5000 {
            bench.step();
            let positions = bench.reals("position", 7).iter().zip(goal);
            let there = positions.map(|(position, goal)| position == goal);
            for (arrived, there) in arrived.iter_mut().zip(there) {
                match there {
                    true => _ = arrived.get_or_insert(cycle),
                    false => *arrived = None,
                }
            }
        }
        arrived.map(|cycle| cycle.expect("it arrives"))
    }

    #[test]
    fn with_synchronize_time_all_joints_that_move_arrive_together_when_the_slowest_can() {
        let alone = arrivals(&mut bench(), &GOAL);
        let slowest = alone.into_iter().max().unwrap();
        assert!(alone.iter().min().unwrap() + 100 < slowest, "{alone:?}");
        let mut bench = bench();
        bench.set_int("synchronize", super::TIME);
        // Joint 3 stays where it is.
        let together = arrivals(&mut bench, &GOAL);
        let (stays, moved) = (together[2], [0, 1, 3, 4, 5, 6].map(|joint| together[joint]));
        // In the last cycle a rest below the jerk of one cycle is skipped.
        let in_time = |arrived: usize| (slowest - 1..=slowest).contains(&arrived);
        assert!(
            stays == 0 && moved.into_iter().all(in_time),
            "{together:?}, alone {alone:?}"
        );
    }

    #[test]
    fn with_synchronize_time_a_goal_that_changes_in_motion_is_reached_together_too() {
        let mut bench = bench();
        bench.set_int("synchronize", super::TIME);
        (0..200).for_each(|_| _ = bench.step());
        let mut goal = GOAL;
        (goal[0], goal[2], goal[5]) = (0.1, 0.3, 0.9);
        bench.set_reals("goal", &goal);
        let arrived = arrivals(&mut bench, &goal);
        let [first, last] = [arrived.iter().min(), arrived.iter().max()].map(Option::unwrap);
        assert!(last - first <= 1 && *first > 200, "{arrived:?}");
        assert_eq!(bench.bool("done"), Some(true));
    }

    #[test]
    fn with_synchronize_time_a_stop_and_a_speed_act_as_without() {
        let mut bench = bench();
        bench.set_int("synchronize", super::TIME);
        (0..100).for_each(|_| _ = bench.step());
        bench.set_bool("stop", Some(true));
        (0..1000).for_each(|_| _ = bench.step());
        assert_eq!(bench.bool("done"), Some(true));
        assert_ne!(bench.reals("position", 7), GOAL);
        bench.set_bool("stop", Some(false)).set_real("speed", 0.1);
        let arrived = arrivals(&mut bench, &GOAL);
        let moved = [0, 1, 3, 4, 5, 6].map(|joint| arrived[joint]);
        let [first, last] = [moved.iter().min(), moved.iter().max()].map(Option::unwrap);
        assert!(last - first <= 1 && *last > 1000, "{arrived:?}");
    }

    #[test]
    fn the_first_set_point_is_the_hold_position_so_that_the_next_ones_keep_the_jerk_limit() {
        for synchronize in [0, super::TIME] {
            let mut bench = bench();
            bench.set_int("synchronize", synchronize);
            keeps_the_jerk_limit(bench);
        }
    }

    fn keeps_the_jerk_limit(mut bench: PrimitiveHarness) {
        let jerk_max = bench.model.limits.jerk_max;
        let mut rows = [HOLD; 4];
        for cycle in 0..3000 {
            bench.step();
            rows.rotate_left(1);
            rows[3].copy_from_slice(bench.reals("position", 7));
            if cycle == 0 {
                assert_eq!(rows[3], HOLD);
            }
            for joint in 0..7 {
                let [p3, p2, p1, p] = rows.map(|row| row[joint]);
                let jerk = (p - 3.0 * p1 + 3.0 * p2 - p3) / 1e-9;
                assert!(
                    jerk.abs() <= jerk_max[joint] * (1.0 + 1e-4),
                    "{cycle}: {jerk}"
                );
            }
        }
    }

    #[test]
    fn a_given_limit_applies_where_it_is_lower_than_the_robot_s() {
        let mut bench = bench();
        bench
            .set_real("velocity", 0.1)
            .set_real("acceleration", 1e6);
        let fastest = (0..2000).map(|_| {
            let velocities = bench.step().reals("velocity", 7).iter();
            velocities.fold(0.0_f64, |most, v| most.max(v.abs()))
        });
        let fastest = fastest.fold(0.0, f64::max);
        assert!((fastest - 0.1).abs() < 1e-9, "{fastest}");
    }

    #[test]
    fn a_goal_beyond_a_joint_s_range_is_ignored() {
        let mut bench = bench();
        (0..50).for_each(|_| _ = bench.step());
        let mut far = GOAL;
        far[3] = 3.0;
        bench.set_reals("goal", &far);
        (0..2000).for_each(|_| _ = bench.step());
        assert_eq!(bench.bool("accepted"), Some(false));
        assert_eq!(bench.bool("done"), Some(false));
        assert_eq!(bench.reals("velocity", 7), [0.0; 7]);
    }

    #[test]
    fn a_stop_ends_at_rest_and_null_is_a_stop() {
        for stop in [None, Some(true)] {
            let mut bench = bench();
            (0..50).for_each(|_| _ = bench.step());
            assert_eq!(
                bench.set_bool("stop", stop).step().bool("done"),
                Some(false)
            );
            (0..1000).for_each(|_| _ = bench.step());
            assert_eq!(bench.bool("done"), Some(true));
            assert_ne!(bench.reals("position", 7), GOAL);
        }
    }

    #[test]
    fn an_unknown_hold_set_point_refuses_the_motion() {
        let mut bench = PrimitiveHarness::new("JointGoal");
        bench.hold = None;
        let fault = PrepareFault::HoldUnknown { device: 0 };
        assert_eq!(bench.prepare(), Err(fault));
    }
}
