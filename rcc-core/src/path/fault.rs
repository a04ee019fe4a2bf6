//! Why a path cannot be made, or not be gone along: places on it, joints, values and limits, for words elsewhere.
//! Plain data; made off the real-time thread.

use serde::{Deserialize, Serialize};

/// What a limit is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// The position of the flange: m/s, m/s², m/s³.
    Line,
    /// Its orientation: rad/s, rad/s², rad/s³.
    Turn,
    /// A joint, from 0: rad/s, rad/s², rad/s³.
    Joint(u8),
}

/// Why a leg of a path cannot be gone along.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum MotionFault {
    /// It turns by 180°: both ways are equally short.
    AmbiguousRotation,
    /// Speed, acceleration and jerk are useless together: they leave nothing for a bend of the path.
    Limits,
    /// There is no such motion in the plan.
    NoMotion,
    /// A pose, joint or angle is null or not finite, or joints are missing.
    NotFinite,
    /// There is no leg, or there are too many.
    Legs {
        /// How many there are.
        count: u32,
    },
    /// More joints are given than the arm has.
    JointCount {
        /// How many the arm has.
        joints: u8,
    },
    /// The three points of an arc lie on a line.
    Collinear,
    /// The angle of an arc is 0.
    NoAngle,
    /// Two points of a path are one.
    Coincident {
        /// How far they are from each other, m.
        distance_m: f64,
    },
    /// A point of a spline is turned too far from the middle one.
    TurnsTooFar {
        /// By how much, rad; 4 at most.
        angle_rad: f64,
    },
    /// An arm angle is given, and the arm has none: it has six joints.
    NoArmAngle,
    /// The roundings at both ends leave no way on which the elbow could turn.
    NoRoomForElbow,
    /// A Status is given, and the arm has none: it has seven joints.
    NoStatus,
    /// The flange cannot be brought there.
    Unreachable {
        /// Part of the leg, 0 to 1.
        fraction: f64,
    },
    /// A joint would have to be beyond its limit.
    JointRange {
        /// Part of the leg, 0 to 1.
        fraction: f64,
        /// From 0.
        joint: u8,
        /// Where it would be, rad.
        value: f64,
        /// Its limit, rad.
        limit: f64,
    },
    /// A joint jumps: the leg goes through a singular position.
    Singular {
        /// Part of the leg, 0 to 1.
        fraction: f64,
        /// From 0.
        joint: u8,
    },
    /// The speed that is given is too fast for the joints, or for a bend of the path.
    TooFast {
        /// Part of the leg, 0 to 1.
        fraction: f64,
        /// What would be beyond its limit.
        quantity: Quantity,
        /// 1 velocity, 2 acceleration, 3 jerk.
        order: u8,
        /// What it would come to.
        value: f64,
        /// What is allowed.
        limit: f64,
        /// The part of the given speed that is possible.
        possible: f64,
    },
}

impl MotionFault {
    /// The same with its place on the leg mapped.
    #[must_use]
    pub fn at(mut self, place: impl Fn(f64) -> f64) -> Self {
        match &mut self {
            Self::Unreachable { fraction }
            | Self::JointRange { fraction, .. }
            | Self::Singular { fraction, .. }
            | Self::TooFast { fraction, .. } => *fraction = place(*fraction),
            _ => {}
        }
        self
    }
}
