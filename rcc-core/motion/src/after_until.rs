//! The leg after a leg that `until` ended early: a straight line, of the joints or of the flange, from the arm's point
//! of rest to the planned goal. Its limits are computed when the motion is built; the real-time thread builds the line
//! itself, without allocation and in a bounded number of steps.
//!
//! A line of joints keeps its limits whatever its start is: each joint moves in proportion, within its range. For a line
//! of the flange the limits are computed from places along the leg before, close enough to each other that between two
//! of them the tighter limits, with a margin, hold.

use rcc_core::kinematics::{Arm, ArmConfiguration};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::PathLimits;
use rcc_core::pose::Pose;

use crate::geometry::PathMetric;
use crate::geometry::jet::{Jet, JetScalar};
use crate::geometry::line::{JointLine, Line};
use crate::planned_path::flange_speed;

mod limits;

/// Part of a joint's limits that is used on a line of joints: the rest covers the rounding of differences.
const JOINT_SHARE: f64 = 1.0 - 1e-6;

/// Velocity, acceleration and jerk of a clock.
type ClockLimits = [f64; 3];

/// The end of an interval of the leg before, in units of its clock, and the limits in it.
type Interval = (f64, ClockLimits);

/// The line to the goal of a leg.
#[derive(Debug, Clone)]
enum LineToGoal {
    /// Limits of each joint.
    Joints([[f64; 3]; JOINTS_MAX]),
    Flange(FlangeGoal),
}

/// The goal of a line of the flange, and its limits by the place where the leg before was ended.
#[derive(Debug, Clone)]
struct FlangeGoal {
    pose: Pose,
    metric: PathMetric,
    configuration: ArmConfiguration,
    /// Ends of the intervals, in units of the clock of the leg before, with the limits in the interval that ends there.
    intervals: Box<[Interval]>,
}

/// How a leg is travelled after the leg before it was ended early.
#[derive(Debug, Clone)]
pub(crate) struct LegAfterUntil {
    arm: Arm,
    /// Joints at its end, rad.
    goal: Joints,
    line: LineToGoal,
}

/// Where an arm came to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RestPoint {
    pub(crate) joints: Joints,
    pub(crate) pose: Pose,
    /// Position on the leg that was ended, in units of its clock.
    pub(crate) clock_value: f64,
}

/// A line from where the arm came to rest.
#[derive(Debug, Clone, Copy)]
enum Shape {
    Joints(JointLine),
    Flange {
        line: Line,
        configuration: ArmConfiguration,
    },
}

/// A leg that is travelled from where the leg before it was ended.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LineFromRest {
    arm: Arm,
    pub(crate) from: RestPoint,
    goal: Joints,
    shape: Shape,
    /// Limits of its clock.
    pub(crate) limits: PathLimits,
}

impl LegAfterUntil {
    /// The line from a point of rest to the goal; `None` if there is none, which was checked when the motion was built.
    pub(crate) fn from(&self, from: RestPoint) -> Option<LineFromRest> {
        let (shape, length, limits) = match &self.line {
            LineToGoal::Joints(bounds) => {
                let line = JointLine::new(&from.joints, &self.goal, 1.0).ok()?;
                let ways = from.joints.iter().zip(self.goal).zip(bounds);
                let mut limits = [f64::INFINITY; 3];
                for ((from, to), bounds) in ways {
                    let share = (to - from).abs() / line.length();
                    for (limit, bound) in limits.iter_mut().zip(bounds) {
                        let allowed = bound * JOINT_SHARE / share;
                        // A joint that does not move gives infinity or NaN, and limits nothing.
                        *limit = if allowed < *limit { allowed } else { *limit };
                    }
                }
                (Shape::Joints(line), line.length(), limits)
            }
            LineToGoal::Flange(goal) => {
                let line = Line::new(&from.pose, &goal.pose, goal.metric).ok()?;
                let mut intervals = goal.intervals.iter();
                let there = intervals.find(|(end, _)| from.clock_value <= *end);
                let (_, limits) = there.or(goal.intervals.last())?;
                let shape = Shape::Flange {
                    line,
                    configuration: goal.configuration,
                };
                (shape, line.length(), *limits)
            }
        };
        // A line without a length is over at once, whatever its limits are.
        let known = |limit: f64| {
            if limit.is_finite() && limit > 0.0 {
                limit
            } else {
                1.0
            }
        };
        let [velocity, acceleration, jerk] = limits.map(known);
        Some(LineFromRest {
            arm: self.arm,
            from,
            goal: self.goal,
            shape,
            limits: PathLimits {
                length,
                velocity,
                acceleration,
                jerk,
            },
        })
    }
}

/// The state on a line from rest.
pub(crate) struct LinePoint {
    pub(crate) pose: Pose,
    pub(crate) joints: Joints,
    /// Metres of the flange per unit of the clock.
    pub(crate) metres_per_s: f64,
}

impl LineFromRest {
    /// The state at clock value `s`, 0 to the length of the limits.
    pub(crate) fn at(&self, s: f64) -> LinePoint {
        let null = [rcc_core::types::NULL_REAL; JOINTS_MAX];
        match &self.shape {
            Shape::Joints(line) => {
                let jets = line.at(Jet::variable(s));
                let joints = jets.map(JetScalar::value);
                LinePoint {
                    pose: self.arm.forward(&joints),
                    joints,
                    metres_per_s: flange_speed(self.arm, &jets),
                }
            }
            Shape::Flange {
                line,
                configuration: ArmConfiguration { branch, arm_angle },
            } => {
                let pose = line.at(s).pose();
                let fraction = if line.length() > 0.0 {
                    s / line.length()
                } else {
                    0.0
                };
                // The hint selects the turn of each joint.
                let ends = self.from.joints.iter().zip(self.goal);
                let mut hint = [0.0; JOINTS_MAX];
                for (hint, (from, to)) in hint.iter_mut().zip(ends) {
                    *hint = from + (to - from) * fraction;
                }
                let joints = self.arm.inverse(&pose, *arm_angle, *branch, &hint);
                LinePoint {
                    pose,
                    joints: if s > 0.0 {
                        joints.unwrap_or(null)
                    } else {
                        self.from.joints
                    },
                    metres_per_s: line.speed(),
                }
            }
        }
    }

    /// Words that [`LineFromRest::words`] gives.
    pub(crate) const WORDS: usize = JOINTS_MAX + 8;

    /// The point of rest as words, from which the line can be built again.
    pub(crate) fn words(&self) -> [u64; Self::WORDS] {
        let RestPoint {
            joints,
            pose,
            clock_value,
        } = self.from;
        let numbers = joints
            .into_iter()
            .chain(pose.to_slots())
            .chain([clock_value]);
        let mut words = [0; Self::WORDS];
        for (word, number) in words.iter_mut().zip(numbers) {
            *word = number.to_bits();
        }
        words
    }
}

impl RestPoint {
    /// The point that [`LineFromRest::words`] gave.
    pub(crate) fn from_words(words: &[u64; LineFromRest::WORDS]) -> Self {
        let mut numbers = words.iter().map(|word| f64::from_bits(*word));
        let mut next = || numbers.next().unwrap_or(f64::NAN);
        let joints = core::array::from_fn(|_| next());
        let pose = Pose::from_slots(core::array::from_fn(|_| next()));
        Self {
            joints,
            pose,
            clock_value: next(),
        }
    }
}
