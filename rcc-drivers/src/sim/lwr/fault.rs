//! Why the simulated controller has stopped the arm, and why it stays in monitor state.
//! Plain data; created by the clock thread, read through the control port.

use crate::fri_lwr::wire::Quality;
use thiserror::Error;

/// Cause of a stop. Joints are counted from 0 here and from 1 in messages.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum KrcFault {
    /// More consecutive answers were missed than are bridged.
    #[error(
        "{misses} answers in a row were missed; the PC must answer every datagram within its cycle"
    )]
    Lost {
        /// Number of consecutive missed answers.
        misses: u32,
    },
    /// The connection quality fell to UNACCEPTABLE in command state.
    #[error(
        "the connection's quality fell to UNACCEPTABLE ({answered} of the last 100 cycles were answered)"
    )]
    Quality {
        /// Number of answered cycles among the last 100.
        answered: usize,
    },
    /// The first command differs from the controller's own position.
    #[error(
        "at the entry joint {} was commanded to {value} rad, the controller is at {own} rad (tolerance {tolerance} rad); \
         mirror commanded position + offset until command state",
        joint + 1
    )]
    Mirror {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad.
        value: f64,
        /// The controller's own position, rad.
        own: f64,
        /// Tolerance, rad.
        tolerance: f64,
    },
    /// A commanded position is out of range.
    #[error("joint {} was commanded to {value} rad, the limit is ±{limit} rad", joint + 1)]
    Position {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad.
        value: f64,
        /// Limit, rad.
        limit: f64,
    },
    /// The commanded positions exceed the velocity limit.
    #[error("joint {} was commanded with {value} rad/s, the limit is ±{limit} rad/s", joint + 1)]
    Velocity {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad/s.
        value: f64,
        /// Limit, rad/s.
        limit: f64,
    },
    /// The commanded positions exceed the acceleration limit.
    #[error("joint {} was commanded with {value} rad/s², the limit is ±{limit} rad/s²", joint + 1)]
    Acceleration {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad/s².
        value: f64,
        /// Limit, rad/s².
        limit: f64,
    },
    /// A commanded position is NaN or infinite.
    #[error("joint {} was commanded to a value that is not a number", joint + 1)]
    NotFinite {
        /// Index of the joint.
        joint: usize,
    },
    /// The command flags do not match the strategy, or have changed in command state.
    #[error(
        "the command flags are {have:#06x}, the strategy takes {want:#06x}; flags may change in monitor state only"
    )]
    Flags {
        /// Expected.
        want: u32,
        /// Received.
        have: u32,
    },
    /// The emergency stop was pressed.
    #[error("the emergency stop was pressed")]
    EmergencyStop,
    /// The drives were switched off in command state.
    #[error("the drives were switched off")]
    DrivesOff,
    /// A stiffness, damping, force or torque outside the range of KRL.
    #[error("{what} {} was commanded to {value}, the range is {least} to {greatest}", element + 1)]
    Impedance {
        /// Name of the quantity.
        what: &'static str,
        /// Index of the axis (x y z rx ry rz) or joint.
        element: usize,
        /// Commanded.
        value: f64,
        /// Minimum.
        least: f64,
        /// Maximum.
        greatest: f64,
    },
    /// The commanded pose is invalid, or does not match the commanded joint positions.
    #[error(
        "the commanded pose is {distance} m and {angle} rad away from that of the commanded joint positions (allowed 0.001 m, \
         0.01 rad)"
    )]
    Pose {
        /// Distance, m.
        distance: f64,
        /// Angle, rad.
        angle: f64,
    },
    /// An added force or torque at the entry into command state.
    #[error(
        "at the entry {value} N or N·m were commanded on top (allowed 1): cmd.addJntTrq not properly initialized"
    )]
    Added {
        /// Largest added value, N or N·m.
        value: f64,
    },
}

impl KrcFault {
    /// Returns the code that the KRL program reports in `$FRI_TO_INT[2]`: 1 to 13 in the order above; 0 means no fault.
    pub fn code(&self) -> i32 {
        match self {
            Self::Lost { .. } => 1,
            Self::Quality { .. } => 2,
            Self::Mirror { .. } => 3,
            Self::Position { .. } => 4,
            Self::Velocity { .. } => 5,
            Self::Acceleration { .. } => 6,
            Self::NotFinite { .. } => 7,
            Self::Flags { .. } => 8,
            Self::EmergencyStop => 9,
            Self::DrivesOff => 10,
            Self::Impedance { .. } => 11,
            Self::Pose { .. } => 12,
            Self::Added { .. } => 13,
        }
    }

    /// Returns the drives that report an error because of this fault, one bit per drive.
    pub fn drive_bits(&self) -> u16 {
        match *self {
            Self::Mirror { joint, .. }
            | Self::Position { joint, .. }
            | Self::Velocity { joint, .. }
            | Self::Acceleration { joint, .. }
            | Self::NotFinite { joint } => 1 << joint,
            _ => 0,
        }
    }
}

/// Why the controller stays in monitor state.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum MonitorReason {
    /// A fault has not been acknowledged.
    #[error("a fault is not acknowledged")]
    Acknowledgement,
    /// The emergency stop is pressed.
    #[error("the emergency stop is pressed")]
    EmergencyStop,
    /// The drives are off.
    #[error("the drives are off")]
    Drives,
    /// The arm moves.
    #[error("the arm moves")]
    Rest,
    /// The last datagram was not answered.
    #[error("the PC does not answer")]
    Answer,
    /// The connection quality is below OK.
    #[error("the quality is {0:?}, at least Ok is needed")]
    Quality(Quality),
    /// The command flags do not match the strategy.
    #[error("the command flags are {have:#06x}, {want:#06x} is needed")]
    Flags {
        /// Expected.
        want: u32,
        /// Received.
        have: u32,
    },
    /// The PC does not mirror.
    #[error("the PC does not mirror: joint {} is commanded to {value} rad, the controller is at {own} rad", joint + 1)]
    Mirror {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad.
        value: f64,
        /// The controller's own position, rad.
        own: f64,
    },
    /// The PC does not request command mode; holds the value of `$FRI_FRM_INT[1]`.
    #[error("the PC does not ask for command mode ($FRI_FRM_INT[1] is {0}, 1 or 10 asks)")]
    Request(i32),
    /// The KRL program is ending.
    #[error("the controller's program is ending")]
    Closing,
}
