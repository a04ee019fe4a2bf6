//! `PoseGoal`: moves a flange to a pose that may change in any cycle, jerk-limited in six axes.
//!
//! The position moves along x, y and z of the arm's base, the orientation in the elements of the rotation vector from
//! its start. This chart has no singularity in this direction, and the flange never rotates faster than the vector
//! changes, because the left Jacobian of the rotation group never increases lengths (Solà, Deray and Atchuthan, A micro
//! Lie theory for state estimation in robotics, arXiv:1812.01537, appendix B).

use core::f64::consts::TAU;

use crate::axis::{AXIS_WORDS, AxisFollower, AxisSlot, axes, is_new, rest_at, share_of, step_axis};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::path::MotionLimits;
use crate::pose::Pose;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Device, Kernel, NullRule, Parameter, Port, Prepare, Real,
    Rotation, Slot, Spec, StateSpec, Step, UnitRule, operands,
};
use crate::rotation::{exp, inverse, log, product, unit};
use crate::types::{NULL_BOOL, NULL_REAL, Type};
use crate::unit::Unit;
use crate::vector::{norm, scale};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "PoseGoal",
        summary: "Moves a flange to a pose that may change in any cycle, as fast as limits of velocity, acceleration and jerk of each axis allow.",
        null: "a null goal or `speed` brings the flange to rest and keeps it there; a null `stop` counts as true",
        null_rule: NullRule::Known,
        formula: "x, y, z and the three elements of the rotation vector from the first orientation, each independently as ScalarGoal; in the first cycle the flange is at rest at the arm's hold set-point",
        inputs: &[
            Port::typed("goal", Type::Pose, "goal of the flange, in the arm's base"),
            Port::real(
                "speed",
                UnitRule::ONE,
                "fraction of the velocity limits to use; computed values above 1 count as 1, values below 0.0001 as 0 (a stop)",
            )
            .default(DefaultValue::Real(1.0)).within(0.0, 1.0),
            Port::bool("stop", "while true, it brakes to rest and stays there; afterwards it continues")
                .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::typed("pose", Type::Pose, "set-point of the flange in the arm's base"),
            Port::bool("done", "at rest: at the goal, or where a stop ended"),
            Port::real(
                "flange_speed",
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "velocity of the flange's position",
            )
            .diagnostic(),
        ],
        parameters: &[
            Parameter::arm(),
            Parameter::real(
                "velocity",
                UnitRule::Is(Unit::METRE_PER_SECOND),
                "largest speed along each of x, y and z",
            )
            .above(0.0),
            Parameter::real(
                "acceleration",
                UnitRule::Is(Unit::METRE_PER_SECOND2),
                "largest acceleration along each of x, y and z",
            )
            .above(0.0),
            Parameter::real(
                "jerk",
                UnitRule::Is(Unit::METRE_PER_SECOND3),
                "largest jerk along each of x, y and z",
            )
            .above(0.0),
            Parameter::real(
                "angular_velocity",
                UnitRule::Is(Unit::RADIAN_PER_SECOND),
                "largest rate of each element of the rotation vector",
            )
            .default(DefaultValue::Real(1.0))
            .above(0.0),
            Parameter::real(
                "angular_acceleration",
                UnitRule::Is(Unit::RADIAN_PER_SECOND2),
                "largest second derivative of each element of the rotation vector",
            )
            .default(DefaultValue::Real(4.0))
            .above(0.0),
            Parameter::real(
                "angular_jerk",
                UnitRule::Is(Unit::RADIAN_PER_SECOND3),
                "largest third derivative of each element of the rotation vector",
            )
            .default(DefaultValue::Real(40.0))
            .above(0.0),
        ],
        state: StateSpec {
            reals: (6 * AXIS_WORDS + 4) as u32,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<PoseGoal>()],
)
.prepared_by::<PoseGoal>();

operands! {
    struct PoseGoal {
        goal: Slot<Pose>, speed: Slot<Real>, stop: Slot<Bool>,
        pose: Slot<Pose>, done: Slot<Bool>, flange_speed: Slot<Real>,
        device: Device, velocity: Slot<Real>, acceleration: Slot<Real>, jerk: Slot<Real>,
        angular_velocity: Slot<Real>, angular_acceleration: Slot<Real>, angular_jerk: Slot<Real>,
        /// Six axes; the first orientation follows.
        state: AxisSlot,
    }
}

impl PoseGoal {
    fn first_orientation(self) -> Slot<Rotation> {
        (self.state + SIX * AXIS_WORDS as u32).cast()
    }
}

impl Prepare for PoseGoal {
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault> {
        let (arm, hold) = preparation.arm_at_rest(self.device)?;
        let Pose {
            position: [x, y, z],
            orientation,
        } = arm.forward(&hold);
        let positions = [x, y, z, 0.0, 0.0, 0.0];
        for (position, slot) in positions.into_iter().zip(axes(self.state, SIX)) {
            preparation.put(slot, rest_at(position));
        }
        preparation.put(self.first_orientation(), orientation);
        Ok(())
    }
}

impl Step for PoseGoal {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let share = share_of(frame, self.speed, self.stop)?;
        let stopped = frame.get(self.stop)? != 0;
        let line = limits(frame, [self.velocity, self.acceleration, self.jerk], share)?;
        let turn = [
            self.angular_velocity,
            self.angular_acceleration,
            self.angular_jerk,
        ];
        let turn = limits(frame, turn, share)?;
        let first = unit(frame.get(self.first_orientation())?);
        let mut now = [NULL_REAL; SIX as usize];
        for (place, slot) in now.iter_mut().zip(axes(self.state, SIX)) {
            *place = AxisFollower::from_words(&frame.get(slot)?).state().position;
        }
        let [.., rx, ry, rz] = now;
        let goal = frame.known_pose(self.goal).zip(first).map(|(goal, first)| {
            let [x, y, z] = goal.position;
            let turned = log(product(inverse(first), goal.orientation));
            let [a, b, c] = nearest_turn(turned, [rx, ry, rz]);
            [x, y, z, a, b, c]
        });
        let begins = is_new(frame, self.state)?;
        let axes = step_six(frame, self.state, goal.filter(|_| !begins), [&line, &turn]);
        let result = axes.zip(first).map(|(axes, first)| {
            let [x, y, z, a, b, c] = axes.map(|axis| axis.state().position);
            Pose {
                position: [x, y, z],
                orientation: product(first, exp([a, b, c])),
            }
        });
        frame.put_pose(self.pose, result)?;
        let at_rest = axes.map(|axes| {
            let there = axes.iter().all(AxisFollower::arrived);
            u8::from(there || stopped && axes.iter().all(|axis| axis.state().rests()))
        });
        frame.put(self.done, at_rest.unwrap_or(NULL_BOOL))?;
        let speed = axes.map(|axes| {
            let [x, y, z, ..] = axes.map(|axis| axis.state().velocity);
            norm([x, y, z])
        });
        frame.put(self.flange_speed, speed.unwrap_or(NULL_REAL))
    }
}

/// Number of axes of a pose: three of the position, three of the rotation.
pub(super) const SIX: u32 = 6;

/// Reads velocity, acceleration and jerk; the velocity is scaled by a share.
pub(super) fn limits(
    frame: &Frame<'_>,
    [velocity, acceleration, jerk]: [Slot<Real>; 3],
    share: f64,
) -> Option<MotionLimits> {
    Some(MotionLimits {
        velocity: frame.get(velocity)? * share,
        acceleration: frame.get(acceleration)?,
        jerk: frame.get(jerk)?,
    })
}

/// Steps six axes, three with the first limits and three with the second; `None` while the position of one is unknown.
pub(super) fn step_six(
    frame: &mut Frame<'_>,
    state: AxisSlot,
    goal: Option<[f64; 6]>,
    [line, turn]: [&MotionLimits; 2],
) -> Option<[AxisFollower; 6]> {
    let mut all = [AxisFollower::at_rest(NULL_REAL); 6];
    let mut goals = goal.unwrap_or([NULL_REAL; 6]).into_iter();
    let limits = [line, line, line, turn, turn, turn];
    let mut known = true;
    for ((place, slot), limits) in all.iter_mut().zip(axes(state, SIX)).zip(limits) {
        match step_axis(frame, slot, goals.next(), limits) {
            Some(axis) => *place = axis,
            None => known = false,
        }
    }
    known.then_some(all)
}

/// Returns the rotation vector of the same rotation, with up to one extra turn, that is nearest to another one.
fn nearest_turn(turn: [f64; 3], to: [f64; 3]) -> [f64; 3] {
    let angle = norm(turn);
    if angle < 1e-9 {
        return turn;
    }
    let other = scale(turn, 1.0 - TAU / angle);
    let apart = |vector: [f64; 3]| {
        let [a, b, c] = vector;
        let [x, y, z] = to;
        norm([a - x, b - y, c - z])
    };
    if apart(other) < apart(turn) {
        other
    } else {
        turn
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    fn bench() -> PrimitiveHarness {
        let mut bench = PrimitiveHarness::new("PoseGoal");
        bench.hold = Some([0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0]);
        let values = [
            ("velocity", 0.2),
            ("acceleration", 1.0),
            ("jerk", 10.0),
            ("angular_velocity", 1.0),
            ("angular_acceleration", 4.0),
            ("angular_jerk", 40.0),
            ("speed", 1.0),
        ];
        for (name, value) in values {
            bench.set_real(name, value);
        }
        bench.set_bool("stop", Some(false));
        bench.prepare().unwrap();
        bench
    }

    fn start(bench: &PrimitiveHarness) -> Pose {
        let hold = bench.hold.unwrap();
        let arm = bench.model.arm.unwrap();
        arm.forward(&hold)
    }

    fn pose(bench: &PrimitiveHarness) -> Pose {
        Pose::from_slots(bench.reals("pose", 7).try_into().unwrap())
    }

    #[test]
    fn goes_from_the_hold_set_point_to_the_goal_and_to_another_on_the_way() {
        let mut bench = bench();
        let from = start(&bench);
        let relative = |xyz, rpy| from.compose(&Pose::from_xyz_rpy(xyz, rpy));
        bench.set_reals(
            "goal",
            &relative([0.1, 0.0, 0.0], [0.5, 0.0, 0.0]).to_slots(),
        );
        assert!(pose(bench.step()).distance_to(&from) < 1e-8);
        (0..300).for_each(|_| _ = bench.step());
        let other = relative([0.0, 0.1, 0.05], [0.0, -2.0, 1.0]);
        let mut last = pose(&bench);
        bench.set_reals("goal", &other.to_slots());
        for _ in 0..5000 {
            let now = pose(bench.step());
            assert!(last.distance_to(&now) <= 0.2e-3 * 3.0_f64.sqrt() * (1.0 + 1e-9));
            assert!(last.angle_to(&now) <= 1e-3 * 3.0_f64.sqrt() * (1.0 + 1e-4));
            last = now;
        }
        assert_eq!(bench.bool("done"), Some(true));
        assert!(last.distance_to(&other) < 1e-12 && last.angle_to(&other) < 1e-7);
    }

    #[test]
    fn a_null_goal_keeps_it_where_it_comes_to_rest() {
        let mut bench = bench();
        let from = start(&bench);
        (0..10).for_each(|_| _ = bench.step());
        assert!(pose(&bench).distance_to(&from) < 1e-15);
        assert_eq!(bench.bool("done"), Some(false));
    }

    #[test]
    fn the_nearest_turn_continues_beyond_180_degrees() {
        let beyond = nearest_turn([-3.0, 0.0, 0.0], [3.1, 0.0, 0.0]);
        assert!((beyond[0] - (TAU - 3.0)).abs() < 1e-12);
        assert_eq!(
            nearest_turn([0.1, 0.0, 0.0], [0.2, 0.0, 0.0]),
            [0.1, 0.0, 0.0]
        );
        assert_eq!(nearest_turn([0.0; 3], [3.0, 0.0, 0.0]), [0.0; 3]);
    }
}
