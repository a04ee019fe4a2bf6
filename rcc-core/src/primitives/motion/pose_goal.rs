//! `PoseGoal`: moves a flange to a pose that may change in any cycle, jerk-limited in six axes.
//!
//! The position moves along x, y and z of the arm's base, the orientation in the elements of the rotation vector from
//! its start. This chart has no singularity in this direction, and the flange never rotates faster than the vector
//! changes, because the left Jacobian of the rotation group never increases lengths (Solà, Deray and Atchuthan, A micro
//! Lie theory for state estimation in robotics, arXiv:1812.01537, appendix B).
//!
//! The limits hold along the way: from rest each axis gets its share of the direction to the goal, so that all three
//! arrive together on a straight line. For a goal that changes on the way no direction is known: each axis gets 1/√3. So
//! does each axis of a motion that is taken over in flight.

use core::f64::consts::TAU;

use crate::axis::{
    AXIS_WORDS, AxisFollower, AxisSlot, AxisState, axes, is_new, rest_at, share_of, step_axis,
};
use crate::frame::{Frame, Preparation, PrepareFault};
use crate::joints::{ArmMotion, Joints};
use crate::kinematics::Arm;
use crate::path::MotionLimits;
use crate::pose::Pose;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Device, Int, Kernel, NullRule, Parameter, Port, Prepare,
    Real, Rotation, Slot, Spec, StateSpec, Step, UnitRule, operands,
};
use crate::primitives::start;
use crate::rotation::{Quaternion, exp, inverse, log, product, unit};
use crate::types::{NULL_BOOL, NULL_REAL, Type};
use crate::unit::Unit;
use crate::vector::{norm, scale};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "PoseGoal",
        summary: "Moves a flange to a pose that may change in any cycle, as fast as limits of velocity, acceleration and jerk along its way allow.",
        null: "a null goal or `speed` brings the flange to rest and keeps it there; a null `stop` counts as true",
        null_rule: NullRule::Known,
        formula: "x, y, z and the three elements of the rotation vector from the first orientation, each as ScalarGoal with its share of the limits: from rest that of the direction to the goal, which gives a straight line; after a change on the way 1/√3, and until the old velocity is braked the flange may be up to 1.3 times as fast; in the first cycle it is at rest at the arm's hold set-point, or where `start: continue` begins",
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
                "largest speed of the flange",
            )
            .above(0.0),
            Parameter::real(
                "acceleration",
                UnitRule::Is(Unit::METRE_PER_SECOND2),
                "largest acceleration of the flange",
            )
            .above(0.0),
            Parameter::real(
                "jerk",
                UnitRule::Is(Unit::METRE_PER_SECOND3),
                "largest jerk of the flange",
            )
            .above(0.0),
            Parameter::real(
                "angular_velocity",
                UnitRule::Is(Unit::RADIAN_PER_SECOND),
                "largest rate of the rotation vector",
            )
            .default(DefaultValue::Real(1.0))
            .above(0.0),
            Parameter::real(
                "angular_acceleration",
                UnitRule::Is(Unit::RADIAN_PER_SECOND2),
                "largest second derivative of the rotation vector",
            )
            .default(DefaultValue::Real(4.0))
            .above(0.0),
            Parameter::real(
                "angular_jerk",
                UnitRule::Is(Unit::RADIAN_PER_SECOND3),
                "largest third derivative of the rotation vector",
            )
            .default(DefaultValue::Real(40.0))
            .above(0.0),
            start::parameter(
                "hold: begins at rest where the arm is held at LOAD or START; continue: begins from pose, velocity and acceleration \
                 of the flange that the net leaves from which a hand-over or a rule takes the arm, and otherwise where the arm is \
                 held",
            ),
        ],
        state: StateSpec {
            reals: (6 * AXIS_WORDS + 4 + 12) as u32,
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
        start: Slot<Int>,
        /// Six axes; the first orientation, the shares of the axes and the goal that they are for follow.
        state: AxisSlot,
    }
}

impl PoseGoal {
    fn first_orientation(self) -> Slot<Rotation> {
        (self.state + SIX * AXIS_WORDS as u32).cast()
    }

    fn shares(self) -> Slot<[Real; 6]> {
        (self.first_orientation() + 4).cast()
    }

    fn shares_goal(self) -> Slot<[Real; 6]> {
        (self.first_orientation() + 10).cast()
    }

    /// In the first cycle with `start: continue`, begins from the motion that the arm is in.
    fn take_over(self, frame: &mut Frame<'_>) -> Option<()> {
        let Some(motion) = start::taken_over(frame, self.device, self.start)? else {
            return Some(());
        };
        let Some(arm) = frame.arm(self.device) else {
            return Some(());
        };
        let rests = motion == ArmMotion::at_rest(motion.position);
        let (orientation, states) = flange_motion(arm, &motion);
        for (state, slot) in states.into_iter().zip(axes(self.state, SIX)) {
            // All axes move or none: a new axis makes its first set-point that of the start.
            let words = match rests {
                true => rest_at(state.position),
                false => AxisFollower::moving(state).words(),
            };
            frame.put(slot, words)?;
        }
        frame.put(self.first_orientation(), orientation)
    }

    /// Returns the share of the limits that each axis gets on the way to `goal`, and stores it: it is chosen once for each
    /// goal.
    fn share(
        self,
        frame: &mut Frame<'_>,
        goal: Option<[f64; 6]>,
        now: &[AxisState; 6],
    ) -> Option<[f64; 6]> {
        let before = frame.get(self.shares())?;
        let Some(goal) = goal else {
            return Some(before.map(|share| if share.is_nan() { EVEN } else { share }));
        };
        if frame.get(self.shares_goal())? == goal {
            return Some(before);
        }
        let shares = if now.iter().all(AxisState::rests) {
            let [gx, gy, gz, ga, gb, gc] = goal;
            let [x, y, z, a, b, c] = now.map(|state| state.position);
            let [x, y, z] = along([gx - x, gy - y, gz - z]);
            let [a, b, c] = along([ga - a, gb - b, gc - c]);
            [x, y, z, a, b, c]
        } else {
            [EVEN; 6]
        };
        frame.put(self.shares(), shares)?;
        frame.put(self.shares_goal(), goal)?;
        Some(shares)
    }
}

/// 1/√3: the share of each of three axes whose direction is not known.
const EVEN: f64 = 0.577_350_269_189_625_8;

/// Smallest share of an axis: one that has nowhere to go still needs limits.
const SHARE_MIN: f64 = 1e-3;

/// Returns the share of each axis of a straight way; the squares add up to 1.
fn along(way: [f64; 3]) -> [f64; 3] {
    let length = norm(way);
    let part = |element: f64| {
        let part = (element / length).abs();
        if part > SHARE_MIN { part } else { SHARE_MIN }
    };
    let shares = way.map(part);
    if length > 0.0 && length.is_finite() {
        scale(shares, 1.0 / norm(shares))
    } else {
        [EVEN; 3]
    }
}

/// Half of the time over which the motion of a flange is differentiated, s: short enough for errors below 1e-9 of the
/// velocity, long enough for a rounding error of the acceleration below 1e-6 m/s².
const HALF_S: f64 = 5e-5;

/// Returns the orientation of a flange, and its six axes: x, y, z and the rotation vector from that orientation. Velocity and
/// acceleration are differences of the poses shortly before and after, as the joints move.
fn flange_motion(arm: &Arm, motion: &ArmMotion) -> (Quaternion, [AxisState; 6]) {
    let at = |t_s: f64| {
        let mut joints: Joints = motion.position;
        let rates = motion.velocity.iter().zip(&motion.acceleration);
        for (joint, (velocity, acceleration)) in joints.iter_mut().zip(rates) {
            *joint += t_s * (velocity + t_s * acceleration / 2.0);
        }
        arm.forward(&joints)
    };
    let here = at(0.0);
    let elements = |pose: Pose| {
        let [x, y, z] = pose.position;
        let [a, b, c] = log(product(inverse(here.orientation), pose.orientation));
        [x, y, z, a, b, c]
    };
    let [before, now, after] = [at(-HALF_S), here, at(HALF_S)].map(elements);
    let states = core::array::from_fn(|axis| {
        let [before, now, after] =
            [before, now, after].map(|elements| elements.get(axis).copied().unwrap_or(NULL_REAL));
        AxisState {
            position: now,
            velocity: (after - before) / (2.0 * HALF_S),
            acceleration: (after - 2.0 * now + before) / (HALF_S * HALF_S),
        }
    });
    (here.orientation, states)
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
        self.take_over(frame)?;
        let first = unit(frame.get(self.first_orientation())?);
        let mut now = [AxisState::at_rest(NULL_REAL); SIX as usize];
        for (place, slot) in now.iter_mut().zip(axes(self.state, SIX)) {
            *place = AxisFollower::from_words(&frame.get(slot)?).state();
        }
        let [.., rx, ry, rz] = now.map(|state| state.position);
        let goal = frame.known_pose(self.goal).zip(first).map(|(goal, first)| {
            let [x, y, z] = goal.position;
            let turned = log(product(inverse(first), goal.orientation));
            let [a, b, c] = nearest_turn(turned, [rx, ry, rz]);
            [x, y, z, a, b, c]
        });
        let begins = is_new(frame, self.state)?;
        let goal = goal.filter(|_| !begins);
        let [x, y, z, a, b, c] = self.share(frame, goal, &now)?;
        let [x, y, z] = [x, y, z].map(|share| scaled(&line, share));
        let [a, b, c] = [a, b, c].map(|share| scaled(&turn, share));
        let axes = step_six(frame, self.state, goal, [&x, &y, &z, &a, &b, &c]);
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

/// Returns a share of limits.
fn scaled(limits: &MotionLimits, share: f64) -> MotionLimits {
    MotionLimits {
        velocity: limits.velocity * share,
        acceleration: limits.acceleration * share,
        jerk: limits.jerk * share,
    }
}

/// Steps six axes, each with its limits; `None` while the position of one is unknown.
pub(super) fn step_six(
    frame: &mut Frame<'_>,
    state: AxisSlot,
    goal: Option<[f64; 6]>,
    limits: [&MotionLimits; 6],
) -> Option<[AxisFollower; 6]> {
    let mut all = [AxisFollower::at_rest(NULL_REAL); 6];
    let mut goals = goal.unwrap_or([NULL_REAL; 6]).into_iter();
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
mod tests;
