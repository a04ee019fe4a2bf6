//! Why the simulated cabinet has ended a motion, why its session does not advance, and why it does not take an answer.
//! Plain data; created by the clock thread, read through the control port.

use crate::fri_iiwa::wire::{Quality, SafetyState, WireError};
use crate::sim::arm::command_stream::StreamFault;
use crate::sim::simulated_robot::Runaway;
use thiserror::Error;

/// Cause of the end of a motion. Joints are counted from 0 here and from 1 in messages.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum CabinetFault {
    /// More consecutive answers were missed than are bridged.
    #[error("{misses} answers in a row were missed; the client must answer within the cycle")]
    Lost {
        /// Number of consecutive missed answers.
        misses: u32,
    },
    /// The connection quality fell below GOOD.
    #[error("the connection's quality fell below GOOD ({answered} of the last 100 answers came)")]
    Quality {
        /// Number of answers among the last 100.
        answered: usize,
    },
    /// A field that the overlay needs is missing.
    #[error("the command has no `{field}`, which the overlay needs (CommandInvalidException)")]
    Missing {
        /// Name of the field.
        field: &'static str,
    },
    /// The first commands differ from the interpolated position.
    #[error(
        "joint {} is commanded to {value} rad while the robot synchronises at {own} rad (tolerance {tolerance} rad): mirror the \
         interpolated position",
        joint + 1
    )]
    Mirror {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad.
        value: f64,
        /// Interpolated, rad.
        own: f64,
        /// Tolerance, rad.
        tolerance: f64,
    },
    /// The first commanded poses differ from the interpolated pose.
    #[error(
        "the commanded pose is {distance} m and {angle} rad away from the interpolated one while the robot synchronises \
         (tolerance 0.001 m, 0.01 rad)"
    )]
    MirrorPose {
        /// Distance, m.
        distance: f64,
        /// Angle, rad.
        angle: f64,
    },
    /// A commanded position is out of range, too fast, or not finite.
    #[error(transparent)]
    Stream(#[from] StreamFault),
    /// A commanded torque, wrench or pose is NaN or infinite.
    #[error("element {} of the commanded {field} is not a number", element + 1)]
    NotFinite {
        /// Name of the field.
        field: &'static str,
        /// Index of the element.
        element: usize,
    },
    /// The quaternion of the commanded pose is not a unit quaternion.
    #[error("the quaternion of the commanded pose has the length {0}, not 1")]
    Rotation(f64),
    /// No joint positions near the last ones have the commanded pose.
    #[error(
        "the commanded pose cannot be reached from the last one: {distance} m and {angle} rad are left; it jumps, or the arm \
         is at a singularity"
    )]
    Unreachable {
        /// Remaining distance, m.
        distance: f64,
        /// Remaining angle, rad.
        angle: f64,
    },
    /// A commanded torque, or the torque for a commanded wrench, exceeds the joint's limit.
    #[error("the command needs {value} N·m of joint {}, the limit is ±{limit} N·m", joint + 1)]
    Torque {
        /// Index of the joint.
        joint: usize,
        /// Commanded or needed, N·m.
        value: f64,
        /// Limit, N·m.
        limit: f64,
    },
    /// The arm itself, which yields in impedance control, has left its range or is too fast.
    #[error(transparent)]
    Runaway(#[from] Runaway),
    /// In T1 the flange may not be faster than 250 mm/s.
    #[error("the flange was commanded with {0} m/s, T1 allows 0.25 m/s")]
    ReducedSpeed(f64),
    /// The safety controller stops the robot.
    #[error("the safety controller stops the robot: {0:?}")]
    Safety(SafetyState),
    /// The drives were switched off.
    #[error("the drives were switched off")]
    DrivesOff,
    /// The operating mode was changed.
    #[error("the operating mode was changed")]
    OperatingMode,
}

impl CabinetFault {
    /// Returns a number for the kind of fault.
    #[must_use]
    pub fn code(&self) -> i32 {
        match self {
            Self::Lost { .. } => 1,
            Self::Quality { .. } => 2,
            Self::Mirror { .. } | Self::MirrorPose { .. } => 3,
            Self::Stream(StreamFault::Position { .. }) => 4,
            Self::Stream(StreamFault::Velocity { .. }) => 5,
            Self::Stream(StreamFault::Acceleration { .. }) => 6,
            Self::Stream(StreamFault::NotFinite { .. }) | Self::NotFinite { .. } => 7,
            Self::Missing { .. } => 8,
            Self::Safety(_) => 9,
            Self::DrivesOff => 10,
            Self::Torque { .. } => 11,
            Self::Rotation(_) | Self::Unreachable { .. } => 12,
            Self::Runaway(_) => 13,
            Self::ReducedSpeed(_) => 14,
            Self::OperatingMode => 15,
        }
    }
}

/// Why the session does not advance to commands that are executed.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum WaitReason {
    /// The application has closed the session.
    #[error("the application has closed the session")]
    Closed,
    /// The client does not answer.
    #[error("the client does not answer")]
    Answer,
    /// The connection quality is below GOOD.
    #[error("the quality is {0:?}, at least Good is needed")]
    Quality(Quality),
    /// A fault has not been acknowledged.
    #[error("a fault is not acknowledged")]
    Acknowledgement,
    /// The safety controller stops the robot.
    #[error("the safety controller stops the robot")]
    Safety,
    /// The drives are not active.
    #[error("the drives are not active")]
    Drives,
    /// The arm moves.
    #[error("the arm moves")]
    Rest,
    /// Commanding needs an answer every 10 ms.
    #[error(
        "an answer comes every {0} ms; for commanding, send period × receive multiplier may be 10 ms at most"
    )]
    Period(u32),
    /// The application has not started a motion.
    #[error("the application has not started a motion: send `start_motion`")]
    Motion,
    /// The robot synchronises with the client.
    #[error("the robot synchronises with the client")]
    Synchronising,
}

/// Why an answer of the client is refused; the cabinet sends nothing in reply.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum AnswerRefusal {
    /// The bytes are not a command message of this version.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The message has a field that this version does not have.
    #[error("the command has `{0}`, which this version of FRI does not have")]
    NotOfVersion(&'static str),
    /// The session is closed.
    #[error("an answer in IDLE: a closed session is not answered")]
    Idle,
    /// It does not reflect the last message.
    #[error("the answer reflects message {have}, the last one is {want}")]
    Late {
        /// The last message.
        want: u32,
        /// Reflected.
        have: u32,
    },
    /// The client's counter does not increase.
    #[error("the client's counter {have} does not follow {last}")]
    Duplicate {
        /// The last one.
        last: u32,
        /// Received.
        have: u32,
    },
    /// The receive multiplier asks for fewer answers.
    #[error("an answer after {after} messages, the receive multiplier is {multiplier}")]
    Early {
        /// Messages since the last answer.
        after: u32,
        /// The receive multiplier.
        multiplier: u32,
    },
    /// A value is NaN or infinite.
    #[error("a commanded value is not a number")]
    NotFinite,
    /// An output is not one of the station's.
    #[error("the station has no output `{0}` of this type")]
    Io(String),
}
