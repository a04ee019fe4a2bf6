//! Why the simulated controller has stopped the arm, why it stays in monitor state, and why it does not take an answer.
//! Plain data; created by the clock thread, read through the control port.

use crate::fri_lwr::wire::{Quality, WireError};
use crate::sim::arm::command_stream::StreamFault;
use crate::sim::simulated_robot::Runaway;
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
    #[error("at the entry {0}; mirror commanded position + offset until command state")]
    Mirror(MirrorError),
    /// A commanded position is out of range, too fast, or not finite.
    #[error(transparent)]
    Stream(#[from] StreamFault),
    /// The command flags have changed in command state.
    #[error(
        "the command flags are {have:#06x}, command state was entered with {want:#06x}; flags may change in monitor state \
         only"
    )]
    Flags {
        /// At the entry.
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
    /// The commanded pose does not match the commanded joint positions.
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
    /// The rotation of the commanded pose is not orthonormal.
    #[error("the rotation of the commanded pose is not orthonormal and right-handed to 0.001")]
    Rotation,
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
    /// The arm itself, which yields in impedance control, has left its range or is too fast.
    #[error(transparent)]
    Runaway(#[from] Runaway),
    /// An added force or torque at the entry into command state.
    #[error(
        "at the entry {value} N or N·m were commanded on top (allowed 1): cmd.addJntTrq not properly initialized"
    )]
    Added {
        /// Largest added value, N or N·m.
        value: f64,
    },
}

/// How a command differs from the controller's own position.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum MirrorError {
    /// A joint is elsewhere.
    #[error(
        "joint {} is commanded to {value} rad, the controller is at {own} rad (tolerance {tolerance} rad)",
        joint + 1
    )]
    Joint {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad.
        value: f64,
        /// The controller's own position, rad.
        own: f64,
        /// Tolerance, rad.
        tolerance: f64,
    },
    /// The pose is elsewhere.
    #[error(
        "the commanded pose is {distance} m and {angle} rad away from the controller's (tolerance 0.001 m, 0.01 rad)"
    )]
    Pose {
        /// Distance, m.
        distance: f64,
        /// Angle, rad.
        angle: f64,
    },
}

impl KrcFault {
    /// Returns the code that the KRL program reports in `$FRI_TO_INT[2]`; 0 means no fault.
    pub fn code(&self) -> i32 {
        match self {
            Self::Lost { .. } => 1,
            Self::Quality { .. } => 2,
            Self::Mirror(_) => 3,
            Self::Stream(StreamFault::Position { .. }) => 4,
            Self::Stream(StreamFault::Velocity { .. }) => 5,
            Self::Stream(StreamFault::Acceleration { .. }) => 6,
            Self::Stream(StreamFault::NotFinite { .. }) => 7,
            Self::Flags { .. } => 8,
            Self::EmergencyStop => 9,
            Self::DrivesOff => 10,
            Self::Impedance { .. } => 11,
            Self::Pose { .. } | Self::Rotation | Self::Unreachable { .. } => 12,
            Self::Added { .. } => 13,
            Self::Runaway(_) => 14,
        }
    }

    /// Returns the drives that report an error because of this fault, one bit per drive.
    pub fn drive_bits(&self) -> u16 {
        match *self {
            Self::Mirror(MirrorError::Joint { joint, .. })
            | Self::Runaway(Runaway { joint, .. }) => 1 << joint,
            Self::Stream(fault) => 1 << fault.joint(),
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
    /// The connection quality is below what the KRL program waits for.
    #[error("the quality is {have:?}, at least {least:?} is needed")]
    Quality {
        /// At present.
        have: Quality,
        /// Lowest quality at which the program continues.
        least: Quality,
    },
    /// The command has flags that the strategy does not read, or no joint position in position control.
    #[error("the command flags are {have:#06x}; the strategy takes {allowed:#06x} or a part of it")]
    Flags {
        /// All that the strategy reads.
        allowed: u32,
        /// Received.
        have: u32,
    },
    /// The PC does not mirror.
    #[error("the PC does not mirror: {0}")]
    Mirror(MirrorError),
    /// The PC does not request command mode.
    #[error(
        "the PC does not ask for command mode ($FRI_FRM_INT[{number}] is {value}, {asks} asks)"
    )]
    Request {
        /// Number of the KRL variable, from 1.
        number: usize,
        /// Its value.
        value: i32,
        /// The values that ask.
        asks: &'static str,
    },
    /// The KRL program is ending.
    #[error("the controller's program is ending")]
    Closing,
}

/// Why an answer of the PC is refused; the controller sends nothing in reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DatagramRefusal {
    /// The bytes are not a command datagram of FRI 1.0.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// It does not reflect the last datagram.
    #[error("the answer reflects datagram {have}, the last one is {want}: it came too late")]
    Late {
        /// The last datagram.
        want: u16,
        /// Reflected.
        have: u16,
    },
    /// The PC's counter does not increase, or the last datagram has been answered.
    #[error("the PC's counter {have} does not follow {last}")]
    Duplicate {
        /// The last one.
        last: u16,
        /// Received.
        have: u16,
    },
    /// A selected position is NaN or infinite, in monitor state.
    #[error("a commanded position is not a number")]
    NotFinite,
}
