//! The limits of a leg after a leg that `until` ended early: computed when the motion is built, for a line of the flange from
//! places along the leg before.

use rcc_core::frame::DeviceModel;
use rcc_core::kinematics::Arm;
use rcc_core::path::{AfterUntilFault, ElbowMotion, Leg, MotionFault, PathSegment, SpeedProfile};

use super::{ClockLimits, FlangeGoal, Interval, JOINT_SHARE, LegAfterUntil, LineToGoal};
use crate::planned_path::{
    ArmStart, LegFault, MotionSection, PathPoint, PlannedPath, build, joint_bounds, metric,
};

/// Number of intervals into which the previous leg is divided at first.
const INTERVALS: usize = 16;
/// Maximum number of times that an interval is halved.
const HALVINGS_MAX: u32 = 4;
/// Two places whose limits differ by more than this factor get another place between them.
const APART: f64 = 1.2;
/// Part of the limits of joints that is used between two places.
const SHARE: f64 = 0.9;
/// Difference of joints (rad) up to which two positions count as the same.
const SAME_RAD: f64 = 1e-6;

impl LegAfterUntil {
    /// The leg of section `number`, which follows a section that `until` may end.
    ///
    /// # Errors
    /// Returns [`MotionFault::AfterUntil`] if the leg cannot begin everywhere on the leg before.
    pub(crate) fn new(
        (model, arm): (&DeviceModel, Arm),
        legs: &[Leg<'_>],
        (path, sections): (&PlannedPath, &[MotionSection]),
        number: usize,
        dt_s: f64,
    ) -> Result<Self, LegFault> {
        let none = (0, MotionFault::NoMotion);
        let section = sections.get(number).ok_or(none)?;
        let before = number.checked_sub(1).and_then(|it| sections.get(it));
        let before = before.ok_or(none)?;
        let [leg_number, last] = section.legs;
        let leg = legs.get(leg_number as usize).ok_or(none)?;
        if leg_number != last {
            return Err((leg_number, MotionFault::NotAtRest));
        }
        let refused = |fault| {
            let fault = MotionFault::AfterUntil {
                fraction: 0.0,
                fault,
            };
            (leg_number, fault)
        };
        let end = section.begin + section.length;
        let goal = path.at(end);
        let line = match leg.segment {
            _ if leg.relative.is_some() => return Err(refused(AfterUntilFault::Relative)),
            PathSegment::Joints { .. } | PathSegment::JointsToPose { .. } => {
                LineToGoal::Joints(joint_bounds(&model.limits, leg.scale))
            }
            PathSegment::Line { .. } => {
                let earlier = number.checked_sub(2).and_then(|it| sections.get(it));
                let begins_known = earlier.is_none_or(|section| section.until.is_none());
                let leg_before = single_flange_leg(before, legs).filter(|_| begins_known);
                let leg_before = leg_before.ok_or(refused(AfterUntilFault::Start))?;
                let stays = |leg: &Leg<'_>| leg.elbow == ElbowMotion::Stays;
                if !stays(leg) || !stays(leg_before) {
                    return Err(refused(AfterUntilFault::Elbow));
                }
                let line = FlangeLine {
                    model,
                    arm,
                    leg: Leg {
                        segment: PathSegment::Line { to: goal.pose },
                        wait: None,
                        until: None,
                        ..*leg
                    },
                    goal: &goal,
                    path,
                    before,
                    dt_s,
                };
                let intervals = line.intervals().map_err(|(fraction, fault)| {
                    (leg_number, MotionFault::AfterUntil { fraction, fault })
                })?;
                LineToGoal::Flange(FlangeGoal {
                    pose: goal.pose,
                    metric: metric(leg),
                    configuration: arm.configuration(&goal.joints),
                    intervals,
                })
            }
            PathSegment::Circle { .. } | PathSegment::Spline { .. } => {
                return Err(refused(AfterUntilFault::Shape));
            }
        };
        Ok(Self {
            arm,
            goal: goal.joints,
            line,
        })
    }
}

/// The leg of a section that has one, if it is a shape of the flange.
fn single_flange_leg<'l, 'a>(section: &MotionSection, legs: &'l [Leg<'a>]) -> Option<&'l Leg<'a>> {
    let [first, last] = section.legs;
    let leg = legs.get(first as usize).filter(|_| first == last)?;
    let joints = matches!(
        leg.segment,
        PathSegment::Joints { .. } | PathSegment::JointsToPose { .. }
    );
    (!joints).then_some(leg)
}

/// The lines of the flange from every place of a leg to the goal of the next one.
struct FlangeLine<'a> {
    model: &'a DeviceModel,
    arm: Arm,
    leg: Leg<'a>,
    goal: &'a PathPoint,
    path: &'a PlannedPath,
    before: &'a MotionSection,
    dt_s: f64,
}

/// A place on the leg before, as a fraction of it, from which the leg cannot begin, and why.
type PlaceFault = (f64, AfterUntilFault);

/// A place on the leg before, as a fraction of it, and the limits of the line from there; `None` for a line without a
/// length.
type Place = (f64, Option<ClockLimits>);

impl FlangeLine<'_> {
    /// The limits between places that are close to each other.
    fn intervals(&self) -> Result<Box<[Interval]>, PlaceFault> {
        let mut intervals = Vec::new();
        let mut left = (0.0, self.limits_from(0.0)?);
        for step in 1..=INTERVALS {
            #[allow(clippy::cast_precision_loss)] // A few dozen at most.
            let fraction = step as f64 / INTERVALS as f64;
            let right = (fraction, self.limits_from(fraction)?);
            self.divide([left, right], HALVINGS_MAX, &mut intervals)?;
            left = right;
        }
        Ok(intervals.into())
    }

    /// Adds the limits between two places, with places between them where the limits differ much.
    fn divide(
        &self,
        [left, right]: [Place; 2],
        halvings: u32,
        intervals: &mut Vec<Interval>,
    ) -> Result<(), PlaceFault> {
        if halvings > 0 && differ(left.1, right.1) {
            let fraction = 0.5 * (left.0 + right.0);
            let middle = (fraction, self.limits_from(fraction)?);
            self.divide([left, middle], halvings - 1, intervals)?;
            return self.divide([middle, right], halvings - 1, intervals);
        }
        let given = self.leg.line.velocity;
        let end = self.clock_value(right.0);
        intervals.push((end, tighter(left.1, right.1, given)));
        Ok(())
    }

    fn clock_value(&self, fraction: f64) -> f64 {
        self.before.begin + self.before.length * fraction
    }

    /// The limits of the line from a place on the leg before.
    fn limits_from(&self, fraction: f64) -> Result<Option<ClockLimits>, PlaceFault> {
        let from = self.path.at(self.clock_value(fraction));
        let start = ArmStart {
            model: self.model,
            arm: self.arm,
            joints: from.joints,
            pose: from.pose,
        };
        let built = build(start, (&[self.leg], SpeedProfile::Uniform), self.dt_s);
        let (path, sections) = built.map_err(|(_, fault)| (fraction, reason(fault)))?;
        let bounds = sections.first().map(|section| &section.bounds);
        let bounds = bounds.filter(|bounds| bounds.length() > 0.0);
        let Some(bounds) = bounds else {
            return Ok(None);
        };
        let end = path.at(bounds.length()).joints;
        let mut ends = end.iter().zip(self.goal.joints);
        if !ends.all(|(end, goal)| (end - goal).abs() <= SAME_RAD) {
            return Err((fraction, AfterUntilFault::Other));
        }
        Ok(Some([
            bounds.least_velocity(),
            bounds.acceleration(),
            bounds.jerk(),
        ]))
    }
}

/// Whether limits differ by more than [`APART`].
fn differ(left: Option<ClockLimits>, right: Option<ClockLimits>) -> bool {
    let (Some(left), Some(right)) = (left, right) else {
        return false;
    };
    let mut pairs = left.iter().zip(right);
    pairs.any(|(left, right)| left.max(right) > APART * left.min(right))
}

/// The limits between two places; `given` is the velocity of the leg, which needs no margin.
fn tighter(left: Option<ClockLimits>, right: Option<ClockLimits>, given: f64) -> ClockLimits {
    let (Some(left), Some(right)) = (left.or(right), right.or(left)) else {
        return [1.0; 3];
    };
    core::array::from_fn(|order| {
        let (low, high) = (left[order].min(right[order]), left[order].max(right[order]));
        if order == 0 && low >= given * JOINT_SHARE {
            return low;
        }
        low * SHARE * (low / high)
    })
}

fn reason(fault: MotionFault) -> AfterUntilFault {
    match fault {
        MotionFault::Unreachable { .. } => AfterUntilFault::Unreachable,
        MotionFault::JointRange { joint, .. } => AfterUntilFault::JointRange { joint },
        MotionFault::Singular { joint, .. } => AfterUntilFault::Singular { joint },
        MotionFault::TooFast { possible, .. } => AfterUntilFault::TooFast { possible },
        _ => AfterUntilFault::Other,
    }
}
