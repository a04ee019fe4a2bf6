//! A path as a net asks for it: legs one after the other.
//! Plain data that primitives hand over when their net is made ready; not for the cycle.

use serde::{Deserialize, Serialize};

use crate::message::Joints;
use crate::pose::Pose;

/// Most legs of a path; each point of a spline counts as one.
pub const LEGS_MAX: usize = 128;

/// Greatest speed, acceleration and jerk of something along its way, in its unit per s, s² and s³ (each > 0; infinite: only
/// what the joints allow).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionLimits {
    /// Per second. If it is finite it is a promise: the leg is gone along that fast, or refused.
    pub velocity: f64,
    /// Per second squared.
    pub acceleration: f64,
    /// Per second cubed.
    pub jerk: f64,
}

impl MotionLimits {
    /// None.
    pub const NONE: MotionLimits = MotionLimits {
        velocity: f64::INFINITY,
        acceleration: f64::INFINITY,
        jerk: f64::INFINITY,
    };

    /// From velocity, acceleration and jerk; null (NaN) is no limit.
    #[must_use]
    pub fn of(values: [f64; 3]) -> MotionLimits {
        let [velocity, acceleration, jerk] =
            values.map(|value| if value.is_nan() { f64::INFINITY } else { value });
        MotionLimits {
            velocity,
            acceleration,
            jerk,
        }
    }
}

/// What the orientation does on an arc.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ArcOrientation {
    /// It turns evenly from that of the start to that of the end.
    #[default]
    Even,
    /// It stays as at the start.
    Constant,
    /// It stays as at the start relative to the path: it turns with the arc.
    Path,
}

/// What poses of a leg are relative to, instead of the arm's base.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RelativeTo {
    /// To the flange at the beginning of the leg, in its axes.
    Tool,
    /// To the flange at the beginning of the leg, in axes of the base: position added, orientation turned.
    Base,
}

/// One piece of a path, from where the one before ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathSegment<'a> {
    /// A straight line of the flange, and the shortest turn.
    Line {
        /// Its end.
        to: Pose,
    },
    /// An arc of the flange.
    Circle {
        /// A point on it.
        via: [f64; 3],
        /// Its end; with an angle, another point on it.
        to: Pose,
        /// What the orientation does.
        orientation: ArcOrientation,
        /// How far around, rad, instead of to `to`; negative: the other way around.
        angle: Option<f64>,
    },
    /// A smooth curve of the flange.
    Spline {
        /// The poses that it goes through, the last one its end.
        through: &'a [Pose],
    },
    /// A straight line of the joints (PTP).
    Joints {
        /// Its end, rad; null where the arm has no joint.
        to: Joints,
    },
    /// A straight line of the joints to where the flange is at a pose.
    JointsToPose {
        /// Of the flange.
        to: Pose,
        /// The branch, 0 to 7; `None`: the one that is reached soonest.
        branch: Option<u8>,
        /// KUKA's Status of a 6-axis arm, which says the branch.
        status: Option<u8>,
        /// KUKA's Turn: bit i is set if joint i + 1 is negative.
        turn: Option<u8>,
    },
}

/// What the elbow of an arm of seven joints does on a leg of the flange: how its arm angle changes, smoothly and along the
/// path, outside of the roundings at its ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ElbowMotion {
    /// The arm angle stays.
    Stays,
    /// It is this at the end, rad, the shorter way round.
    To(f64),
    /// It is in the middle of what the joint limits allow at the end, without leaving the interval that it is in; where they
    /// allow all, it stays.
    Middle,
}

/// A segment and how to go along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg<'a> {
    /// Its shape.
    pub segment: PathSegment<'a>,
    /// What its poses are relative to; `None`: the arm's base.
    pub relative: Option<RelativeTo>,
    /// What the elbow does; it stays on legs of joints.
    pub elbow: ElbowMotion,
    /// Of the flange's position, m.
    pub line: MotionLimits,
    /// Of the flange's orientation, rad.
    pub turn: MotionLimits,
    /// The part of velocity, acceleration and jerk of each joint that it uses, above 0 to 1.
    pub scale: f64,
    /// How far before its end, and behind, the path is rounded into the next leg, m; 0: it rests at its end.
    pub blend: f64,
}

impl<'a> Leg<'a> {
    /// As fast as the joints allow, to rest at its end.
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
        }
    }
}

/// A path that a net asks for.
#[derive(Debug, Clone, Copy)]
pub struct PathRequest<'a> {
    /// Index of the arm.
    pub device: u32,
    /// Flange at the start, in the arm's base, with joints near the hold set-point, on its branch and with its arm angle;
    /// `None`: at the arm's hold set-point.
    pub from: Option<Pose>,
    /// In order; at least one.
    pub legs: &'a [Leg<'a>],
    /// How the speed along the path is chosen.
    pub pace: SpeedProfile,
}

/// How the speed along a path is chosen, within all limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpeedProfile {
    /// Velocity limits for its parts, one acceleration and one jerk for all of it.
    #[default]
    Even,
    /// The law of motion that is soonest at the end. Limits of the flange bind it, too, but a speed that is given is no
    /// promise.
    Fastest,
}
