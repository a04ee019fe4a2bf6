//! Reasons why a net cannot be prepared for its arms, and why a path cannot be built or travelled: places on it, joints,
//! values and limits, which messages are made from elsewhere. Plain data; created off the real-time thread.

use serde::{Deserialize, Serialize};

/// The quantity that a limit applies to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// The position of the flange: m/s, m/s², m/s³.
    Line,
    /// Its orientation: rad/s, rad/s², rad/s³.
    Turn,
    /// A joint, from 0: rad/s, rad/s², rad/s³.
    Joint(u8),
}

/// Why a leg cannot follow a leg that `until` may end anywhere on its way.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum AfterUntilFault {
    /// It is neither a `ptp` nor a `lin`.
    Shape,
    /// Its goal is relative to its beginning, which is not known before the motion.
    Relative,
    /// It, or the leg before it, turns the elbow.
    Elbow,
    /// A `lin` follows, but the leg before it is a `ptp`, or does not begin at rest at a place that is known before START.
    Start,
    /// A pose on the line to the goal is out of reach.
    Unreachable,
    /// A joint would exceed its position limit on the line to the goal.
    JointRange {
        /// The joint, from 0.
        joint: u8,
    },
    /// The line to the goal passes through a singularity.
    Singular {
        /// The joint that would jump, from 0.
        joint: u8,
    },
    /// The given speed is too fast on the line to the goal.
    TooFast {
        /// Fraction of the given speed that is possible.
        possible: f64,
    },
    /// The line to the goal ends at joints other than the planned ones, or cannot be built.
    Other,
}

/// The reason why a leg of a path cannot be travelled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum MotionFault {
    /// The leg rotates by 180°, and both directions are equally short.
    AmbiguousRotation,
    /// The limits of speed, acceleration and jerk cannot be met together: they leave nothing for a curve of the path.
    Limits,
    /// The plan has no such motion.
    NoMotion,
    /// A pose, joint or angle is null or not finite, or joint values are missing.
    NotFinite,
    /// The path has no legs, or too many.
    Legs {
        /// Their number.
        count: u32,
    },
    /// More joint values are given than the arm has joints.
    JointCount {
        /// Number of joints of the arm.
        joints: u8,
    },
    /// The three points of an arc lie on a line.
    Collinear,
    /// The angle of an arc is 0.
    NoAngle,
    /// Two points of a path coincide.
    Coincident {
        /// Distance between them, m.
        distance_m: f64,
    },
    /// The orientation of a spline point is too far from that of the middle point.
    TurnsTooFar {
        /// Angle between them, rad; at most 4.
        angle_rad: f64,
    },
    /// The elbow is to turn, but the arm has no arm angle, or no known range of it.
    NoArmAngle,
    /// A branch is given, but the arm has numeric inverse kinematics and therefore none.
    NoBranch,
    /// The blends at both ends leave no section on which the elbow could move.
    NoRoomForElbow,
    /// A Status is given, but the arm has seven joints or numeric inverse kinematics and therefore has none.
    NoStatus,
    /// `wait` where the motion does not rest before the leg, `until` where it does not rest after it, or a blend at the
    /// end of the leg that follows `until`.
    NotAtRest,
    /// The leg cannot begin everywhere where `until` may end the leg before it.
    AfterUntil {
        /// Position on the leg before, 0 to 1, from which it cannot begin.
        fraction: f64,
        /// Why.
        fault: AfterUntilFault,
    },
    /// The flange pose is out of reach.
    Unreachable {
        /// Position on the leg, 0 to 1.
        fraction: f64,
    },
    /// A joint would exceed its position limit.
    JointRange {
        /// Position on the leg, 0 to 1.
        fraction: f64,
        /// The joint, from 0.
        joint: u8,
        /// Required position, rad.
        value: f64,
        /// Its limit, rad.
        limit: f64,
    },
    /// A joint would jump, because the leg passes through a singularity.
    Singular {
        /// Position on the leg, 0 to 1.
        fraction: f64,
        /// The joint, from 0.
        joint: u8,
    },
    /// The given speed is too fast for the joints, or for a curve of the path.
    TooFast {
        /// Position on the leg, 0 to 1.
        fraction: f64,
        /// The quantity that would exceed its limit.
        quantity: Quantity,
        /// Order of the derivative: 1 velocity, 2 acceleration, 3 jerk.
        order: u8,
        /// Required value.
        value: f64,
        /// Limit.
        limit: f64,
        /// Fraction of the given speed that is possible.
        possible: f64,
    },
}

impl MotionFault {
    /// Returns the fault with its position on the leg mapped by `place`.
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

/// Reason why the start values of a command could not be computed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PrepareFault {
    /// The position of the device is not known: its driver is not running or not connected.
    HoldUnknown {
        /// Device index.
        device: u32,
    },
    /// The device has no kinematics.
    NoArm {
        /// Device index.
        device: u32,
    },
    /// A motion cannot be built as requested.
    Motion {
        /// Index of the motion in its net.
        motion: u32,
        /// The leg, from 0.
        leg: u32,
        /// Reason.
        fault: MotionFault,
    },
}
