//! Faults of a server: reason numbers, their texts, and remedies.
//! Tables, and errors created when a fault occurs; used by the host's thread.

use std::io;
use std::time::Duration;

use thiserror::Error;

use super::frame::FrameError;
use rcc_driver_kit::host::reason::Reason;

/// The server cannot be reached.
pub const UNREACHABLE: u32 = 100;
/// The server did not answer in time.
pub const TIMEOUT: u32 = 101;
/// An exception whose code the standard does not define.
pub const REFUSED: u32 = 102;
/// The bytes received are not a valid answer.
pub const BROKEN: u32 = 103;
/// Another unit answers.
pub const OTHER_UNIT: u32 = 104;
/// The heartbeat has stopped.
pub const FROZEN: u32 = 105;
/// A value that its registers cannot hold.
pub const UNFIT: u32 = 106;
/// The device does not know function 22, which bits of a register are written with.
pub const NO_MASK_WRITE: u32 = 107;
/// Base of the reasons for exceptions: exception n of the standard is this plus n.
pub const EXCEPTIONS: u32 = 110;
/// Offset for devices with named servers: the reasons of server i (from 0) are those above plus (i + 1) times this.
pub const NAMED: u32 = 1000;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        UNREACHABLE,
        "the Modbus server cannot be reached: check its address and port, its power and the cable",
    ),
    (
        TIMEOUT,
        "the Modbus server does not answer within `timeout`",
    ),
    (
        REFUSED,
        "the Modbus server refuses a request with an exception code that the standard does not define; `rcc-cli doctor device` names the point",
    ),
    (BROKEN, "the answer is not Modbus TCP: check the port"),
    (
        OTHER_UNIT,
        "the Modbus server answers as another unit: correct `unit`; `rcc-cli doctor device` names both",
    ),
    (
        FROZEN,
        "the device's heartbeat has stopped: its program is not running, although its Modbus server answers",
    ),
    (
        UNFIT,
        "an analog output has a value that its registers cannot hold; `rcc-cli doctor device` names it",
    ),
    (
        NO_MASK_WRITE,
        "the device does not know function 22 (mask write), with which bits of a register are written: set `mask_write: false`",
    ),
    (
        EXCEPTIONS + 1,
        "illegal function: the device does not know this kind of request; `rcc-cli doctor device` names the point",
    ),
    (
        EXCEPTIONS + 2,
        "illegal address: the device has no such point; compare the channel's address with the manual (the wire counts from 0); `rcc-cli doctor device` names the point",
    ),
    (
        EXCEPTIONS + 3,
        "illegal value: the device refuses a value or a number of points; `rcc-cli doctor device` names the point",
    ),
    (
        EXCEPTIONS + 4,
        "the device failed while it executed a request; see its own diagnosis",
    ),
    (
        EXCEPTIONS + 5,
        "the device has accepted a request but never answers it",
    ),
    (
        EXCEPTIONS + 6,
        "the device is busy for longer than `timeout`",
    ),
    (
        EXCEPTIONS + 8,
        "the device reports a parity error in its memory",
    ),
    (
        EXCEPTIONS + 10,
        "the gateway has no path to the device: check its configuration and `unit`",
    ),
    (
        EXCEPTIONS + 11,
        "the device behind the gateway does not answer: check `unit`, its power and the bus",
    ),
];

/// Exceptions after which the same request may succeed: acknowledge, and server busy.
pub const PASSING: [u8; 2] = [5, 6];

/// Why a server cannot be used at present.
#[derive(Debug, Error)]
pub enum ServerFault {
    /// No connection could be made.
    #[error("it cannot be reached: {0}")]
    Connect(io::Error),
    /// The connection broke.
    #[error("the connection broke: {0}")]
    Transport(io::Error),
    /// The answer did not arrive in time.
    #[error("no answer to {doing} within {} ms", timeout.as_millis())]
    Timeout {
        /// Description of the request.
        doing: String,
        /// The time-out.
        timeout: Duration,
    },
    /// Another unit answers.
    #[error(
        "unit {have} answered a request to unit {want}: set `unit: {have}`, or check the gateway"
    )]
    OtherUnit {
        /// Unit in the request.
        want: u8,
        /// Unit in the answer.
        have: u8,
    },
    /// Not Modbus TCP.
    #[error("invalid response: {0}")]
    Broken(FrameError),
    /// The server answers with an exception.
    #[error("{doing}: exception {code}: {}", description(exception_reason(*code)))]
    Exception {
        /// Description of the request.
        doing: String,
        /// Exception code.
        code: u8,
    },
    /// The server refuses function 22.
    #[error("{doing}: exception 1: {}", description(NO_MASK_WRITE))]
    NoMaskWrite {
        /// Description of the request.
        doing: String,
    },
    /// The heartbeat has stopped.
    #[error("the heartbeat at {address} has not changed for {} ms: is the device's program running?", within.as_millis())]
    Frozen {
        /// Address of the heartbeat.
        address: String,
        /// Time within which it must change.
        within: Duration,
    },
    /// A value that its registers cannot hold.
    #[error(
        "output {channel}: {value} (SI) does not fit into its registers, {lower} to {upper} (raw): check scale and range"
    )]
    Unfit {
        /// Name of the output channel.
        channel: String,
        /// Its value, SI.
        value: f64,
        /// Smallest raw value.
        lower: f64,
        /// Largest raw value.
        upper: f64,
    },
}

impl ServerFault {
    /// Returns the number in [`REASONS`].
    #[must_use]
    pub fn reason(&self) -> u32 {
        match self {
            ServerFault::Connect(_) | ServerFault::Transport(_) => UNREACHABLE,
            ServerFault::Timeout { .. } => TIMEOUT,
            ServerFault::OtherUnit { .. } => OTHER_UNIT,
            ServerFault::Broken(_) => BROKEN,
            ServerFault::Exception { code, .. } => exception_reason(*code),
            ServerFault::NoMaskWrite { .. } => NO_MASK_WRITE,
            ServerFault::Frozen { .. } => FROZEN,
            ServerFault::Unfit { .. } => UNFIT,
        }
    }

    /// Returns true if the connection must be closed.
    #[must_use]
    pub fn ends_connection(&self) -> bool {
        matches!(
            self,
            ServerFault::Connect(_) | ServerFault::Transport(_) | ServerFault::Broken(_)
        )
    }
}

/// Returns the text of a reason.
#[must_use]
pub fn description(reason: u32) -> &'static str {
    let mut rows = REASONS.iter();
    rows.find(|row| row.0 == reason).map_or("", |row| row.1)
}

fn exception_reason(code: u8) -> u32 {
    let reason = EXCEPTIONS + u32::from(code);
    if description(reason).is_empty() {
        REFUSED
    } else {
        reason
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_exception_of_the_standard_has_its_words_and_others_have_some() {
        for code in [1, 2, 3, 4, 5, 6, 8, 10, 11] {
            assert_eq!(exception_reason(code), EXCEPTIONS + u32::from(code));
        }
        for code in [0, 7, 9, 12, 255] {
            assert_eq!(exception_reason(code), REFUSED);
        }
        assert!(REASONS.iter().all(|row| row.0 < NAMED));
    }
}
