//! A path as requested by a net: a sequence of legs. Plain data that primitives pass on when their net is prepared; not
//! used in the cycle.

use crate::axis::MotionLimits;
use crate::joints::Joints;
use crate::pose::Pose;

/// Maximum number of legs of a path; each point of a spline counts as one.
pub const LEGS_MAX: usize = 128;

/// The orientation on an arc.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ArcOrientation {
    /// Rotates at a uniform rate from the orientation of the start to that of the end.
    #[default]
    Even,
    /// Keeps the orientation of the start.
    Constant,
    /// Keeps the orientation of the start relative to the path: it rotates with the arc.
    Path,
}

/// The frame that the poses of a leg are relative to, instead of the arm's base.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RelativeTo {
    /// The flange at the start of the leg, in its axes.
    Tool,
    /// The flange at the start of the leg, in axes of the base: the position is added, the orientation rotated.
    Base,
}

/// The shape of a leg, starting at the end of the previous one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathSegment<'a> {
    /// A straight line of the flange with the shortest rotation.
    Line {
        /// End.
        to: Pose,
    },
    /// An arc of the flange.
    Circle {
        /// A point on the arc.
        via: [f64; 3],
        /// End; with `angle`, another point of the circle.
        to: Pose,
        /// Orientation on the arc.
        orientation: ArcOrientation,
        /// Angle of the arc, rad, instead of the end at `to`; negative: opposite direction.
        angle: Option<f64>,
    },
    /// A smooth curve of the flange.
    Spline {
        /// The poses that the curve passes through; the last one is the end.
        through: &'a [Pose],
    },
    /// A straight line of the joints (PTP).
    Joints {
        /// End, rad; null for joints that the arm does not have.
        to: Joints,
    },
    /// A straight line of the joints to a flange pose.
    JointsToPose {
        /// Flange pose.
        to: Pose,
        /// Branch, 0 to 7; `None`: the one that is reached soonest.
        branch: Option<u8>,
        /// KUKA's Status of a 6-axis arm, which determines the branch.
        status: Option<u8>,
        /// KUKA's Turn: bit i is set if joint i + 1 is negative.
        turn: Option<u8>,
    },
}

/// The elbow motion of a seven-joint arm on a leg of the flange: how the arm angle changes, smoothly along the path,
/// outside the blends at its ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ElbowMotion {
    /// The arm angle stays constant.
    Stays,
    /// The arm angle at the end, rad, approached by the shorter way.
    To(f64),
    /// The arm angle moves to the middle of the range that the joint limits allow at the end, without leaving its
    /// current interval; if every angle is allowed, it stays constant.
    Middle,
}

/// A path segment and the way it is travelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg<'a> {
    /// Shape.
    pub segment: PathSegment<'a>,
    /// Frame of its poses; `None`: the arm's base.
    pub relative: Option<RelativeTo>,
    /// Elbow motion; not used on legs of joints.
    pub elbow: ElbowMotion,
    /// Limits of the flange's position, m.
    pub line: MotionLimits,
    /// Limits of the flange's orientation, rad.
    pub turn: MotionLimits,
    /// Fraction of each joint's velocity, acceleration and jerk limits to use, above 0 to 1.
    pub scale: f64,
    /// Blend distance before and after its end, m, within which the path is rounded into the next leg; 0: it comes to
    /// rest at its end.
    pub blend: f64,
    /// Index of the condition that must hold before it begins.
    pub wait: Option<u32>,
    /// Index of the condition that ends it early: the arm stops on the path, and the next leg begins there.
    pub until: Option<u32>,
}

impl<'a> Leg<'a> {
    /// Creates a leg that is as fast as the joints allow and ends at rest.
    #[must_use]
    pub const fn new(segment: PathSegment<'a>) -> Leg<'a> {
        Leg {
            segment,
            relative: None,
            elbow: ElbowMotion::Stays,
            line: MotionLimits::NONE,
            turn: MotionLimits::NONE,
            scale: 1.0,
            blend: 0.0,
            wait: None,
            until: None,
        }
    }
}

/// The conditions that apply to a motion in a cycle, as indices into the conditions of its primitive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LegConditions {
    /// The leg that is due does not begin before this condition holds.
    pub wait: Option<u32>,
    /// The current leg ends when this condition holds.
    pub until: Option<u32>,
}

/// The conditions of a leg in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LegSignals {
    /// The leg that is due may begin; without effect if it has no condition.
    pub begin: bool,
    /// The current leg is to end; without effect if it has no condition.
    pub end: bool,
}

impl LegSignals {
    /// Begins every leg and ends none early.
    pub const RUN: LegSignals = LegSignals {
        begin: true,
        end: false,
    };
}

/// A path requested by a net.
#[derive(Debug, Clone, Copy)]
pub struct PathRequest<'a> {
    /// Index of the arm.
    pub device: u32,
    /// Flange at the start, in the arm's base, reached with joints near the hold set-point, in its branch and with its
    /// arm angle; `None`: at the arm's hold set-point.
    pub from: Option<Pose>,
    /// Legs in order; at least one.
    pub legs: &'a [Leg<'a>],
    /// The speed profile along a path, within all limits.
    pub pace: SpeedProfile,
}

/// The speed profile along a path, within all limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpeedProfile {
    /// Uniform where that takes little longer and where a speed is given, which is kept; otherwise a time law within the
    /// limits of every place, found quickly.
    #[default]
    Adaptive,
    /// Velocity limits for its parts, one acceleration and one jerk limit for the whole path.
    Uniform,
    /// Time-optimal parameterization. Limits of the flange apply, too, but a given speed is then only a limit.
    TimeOptimal(StopReserve),
}

/// The part of its limits that a time-optimal motion reserves, so that its time can be slowed down within them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReserve {
    /// Enough to be slowed down soon at any time.
    Keep,
    /// Hardly anything: the motion ends sooner, but a pause or an override takes effect slowly, and a stop begins only
    /// where the time law can be left within the limits.
    Give,
}
