//! Datagrams of KUKA's Fast Robot Interface for the LBR iiwa and LBR Med, versions 1.11 to 2.7.
//! Pure functions; run by whichever thread calls them. Decoding allocates, bounded by the size of a datagram.
//!
//! A datagram is one Protocol Buffers message; version 2.7 puts its length before it and a CRC-32 behind it.

pub mod schema;

use std::str::FromStr;

use prost::Message;
use thiserror::Error;

use schema::{Command, Envelope, IoValue, JointValues, Monitoring, Transformation};

/// Number of joints.
pub const JOINTS: usize = 7;
/// Largest datagram in bytes.
pub const DATAGRAM_MAX: usize = 1500;
/// Identity of a [`Monitoring`] message.
pub const MONITORING_ID: u32 = 0x0024_5142;
/// Identity of a [`Command`] message.
pub const COMMAND_ID: u32 = 0x0003_4001;
/// Most inputs and outputs in a message.
pub const IO_MAX: usize = 10;
/// Most transformations in a message.
pub const TRANSFORMATIONS_MAX: usize = 5;
/// Most bytes of the name of an input or output.
pub const IO_NAME_MAX: usize = 63;
/// Bytes before and behind the message in version 2.7.
const FRAME: usize = 4;

/// Versions of the interface that differ on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// 1.11: without inputs and outputs.
    V1_11,
    /// 1.14 to 1.16.
    V1_14,
    /// 2.5: quaternions and Cartesian commands; no commanded position.
    V2_5,
    /// 2.7: length and CRC around each message; external force.
    V2_7,
}

impl Version {
    /// All versions by the names that a configuration gives them.
    pub const NAMES: [(&str, Version); 6] = [
        ("1.11", Version::V1_11),
        ("1.14", Version::V1_14),
        ("1.15", Version::V1_14),
        ("1.16", Version::V1_14),
        ("2.5", Version::V2_5),
        ("2.7", Version::V2_7),
    ];

    /// Returns true if length and CRC stand around each message.
    #[must_use]
    pub fn is_framed(self) -> bool {
        self == Version::V2_7
    }

    /// Returns true if messages carry inputs and outputs.
    #[must_use]
    pub fn has_io(self) -> bool {
        self != Version::V1_11
    }

    /// Returns true for 2.x: poses as quaternions, Cartesian commands, no commanded position.
    #[must_use]
    pub fn is_second(self) -> bool {
        matches!(self, Version::V2_5 | Version::V2_7)
    }

    /// Returns the number of elements of a [`Transformation`].
    #[must_use]
    pub fn transformation_elements(self) -> usize {
        if self.is_second() { 7 } else { 12 }
    }
}

impl FromStr for Version {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let row = Version::NAMES.iter().find(|(name, _)| *name == text);
        row.map(|(_, version)| *version).ok_or(())
    }
}

/// Defines an enumeration of the wire with its conversion from an integer.
macro_rules! wire_enums {
    ($($(#[$doc:meta])* $name:ident { $($(#[$row:meta])* $variant:ident = $value:literal),* $(,)? })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[repr(i32)]
        pub enum $name { $($(#[$row])* $variant = $value),* }

        impl $name {
            /// Returns the value with this number on the wire; `None` if there is none.
            #[must_use]
            pub fn from_wire(number: i32) -> Option<Self> {
                match number {
                    $($value => Some(Self::$variant),)*
                    _ => None,
                }
            }
        }
    )*};
}

wire_enums! {
    /// State of the session.
    SessionState {
        /// Closed.
        Idle = 0,
        /// Open, with a quality below good.
        MonitoringWait = 1,
        /// Open, with at least good quality.
        MonitoringReady = 2,
        /// A motion with an overlay begins; the client must mirror it.
        CommandingWait = 3,
        /// The client's commands are executed.
        CommandingActive = 4,
    }
    /// Rating of the connection.
    Quality {
        /// Worst.
        Poor = 0,
        /// Commanding is not possible.
        Fair = 1,
        /// Least for commanding.
        Good = 2,
        /// Best.
        Excellent = 3,
    }
    /// State of the safety controller.
    SafetyState {
        /// No stop.
        Normal = 0,
        /// Stop 0: drives off at once.
        Stop0 = 1,
        /// Stop 1: drives off after a ramp.
        Stop1 = 2,
        /// Stop 2: at rest, drives on.
        Stop2 = 3,
    }
    /// State of a drive.
    DriveState {
        /// Off.
        Off = 0,
        /// Between off and active.
        Transitioning = 1,
        /// On.
        Active = 2,
    }
    /// Operating mode.
    OperationMode {
        /// Manual, reduced speed.
        T1 = 0,
        /// Manual, full speed.
        T2 = 1,
        /// Automatic.
        Automatic = 2,
    }
    /// Controller of the joints.
    ControlMode {
        /// Position.
        Position = 0,
        /// Cartesian impedance.
        CartesianImpedance = 1,
        /// Joint impedance.
        JointImpedance = 2,
        /// None.
        None = 3,
    }
    /// Quantity that the client may command.
    ClientCommandMode {
        /// Nothing.
        None = 0,
        /// Joint positions.
        JointPosition = 1,
        /// Joint positions and a wrench.
        Wrench = 2,
        /// Joint positions and joint torques.
        Torque = 3,
        /// A pose; 2.x.
        CartesianPose = 4,
    }
    /// Kind of the motion's overlay.
    Overlay {
        /// None.
        None = 0,
        /// Of joints.
        Joint = 1,
        /// Cartesian.
        Cartesian = 2,
    }
    /// Type of an input or output.
    IoKind {
        /// One bit, in `digital`.
        Boolean = 0,
        /// A whole number, in `digital`.
        Digital = 1,
        /// A real number, in `analog`.
        Analog = 2,
    }
    /// Direction of an input or output, as the station sees it.
    IoDirection {
        /// Read by the client.
        Input = 0,
        /// Written by the client.
        Output = 1,
    }
}

/// Why bytes are not the expected message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum WireError {
    /// More than [`DATAGRAM_MAX`] bytes.
    #[error("{0} bytes; a datagram has at most {DATAGRAM_MAX}")]
    Size(usize),
    /// The message is framed although this version has no frame, or the reverse.
    #[error("{0}")]
    OtherFrame(&'static str),
    /// The length before the message is not that of the message.
    #[error("the length field says {told} bytes, but {have} follow")]
    Length {
        /// As the frame says, bytes.
        told: usize,
        /// Between length and CRC, bytes.
        have: usize,
    },
    /// The CRC behind the message is wrong.
    #[error("wrong CRC: received {told:#010x}, computed {computed:#010x}")]
    Checksum {
        /// As the frame says.
        told: u32,
        /// Of the bytes that arrived.
        computed: u32,
    },
    /// The bytes are not Protocol Buffers of this schema.
    #[error("not a message of FRI: {0}")]
    Schema(String),
    /// Another message than the expected one.
    #[error("identity {have:#010x}, expected {want:#010x}")]
    Identity {
        /// Expected.
        want: u32,
        /// Received.
        have: u32,
    },
    /// A required field is missing.
    #[error("`{0}` is missing")]
    Missing(&'static str),
    /// A list has a number of elements that it cannot have.
    #[error("`{field}` has {have} elements, expected {want}")]
    Count {
        /// Name of the list.
        field: &'static str,
        /// Number of elements.
        have: usize,
        /// Expected number, in words.
        want: &'static str,
    },
}

/// One of the two messages.
pub trait FriMessage: Message + Default {
    /// Identity in the header.
    const IDENTITY: u32;

    /// Checks required fields and the lengths of lists.
    ///
    /// # Errors
    /// Returns the first field that is wrong.
    fn check(&self) -> Result<(), WireError>;
}

impl FriMessage for Monitoring {
    const IDENTITY: u32 = MONITORING_ID;

    fn check(&self) -> Result<(), WireError> {
        let connection = self.connection.ok_or(WireError::Missing("connection"))?;
        connection.session.ok_or(WireError::Missing("session"))?;
        connection.quality.ok_or(WireError::Missing("quality"))?;
        check_transformations(&self.transformations)?;
        if let Some(robot) = &self.robot {
            at_most("drives", robot.drives.len(), JOINTS, "at most 7")?;
        }
        let interpolated = self.interpolator.as_ref();
        check_joints("ipo", interpolated.and_then(|ipo| ipo.position.as_ref()))?;
        let Some(data) = &self.data else {
            return Ok(());
        };
        check_joints("measured_position", data.measured_position.as_ref())?;
        check_joints("measured_torque", data.measured_torque.as_ref())?;
        check_joints("commanded_position", data.commanded_position.as_ref())?;
        check_joints("commanded_torque", data.commanded_torque.as_ref())?;
        check_joints("external_torque", data.external_torque.as_ref())?;
        check_wrench("external_force", data.external_force.as_ref())?;
        check_io(&data.io)
    }
}

impl FriMessage for Command {
    const IDENTITY: u32 = COMMAND_ID;

    fn check(&self) -> Result<(), WireError> {
        let Some(data) = &self.data else {
            return Ok(());
        };
        check_joints("position", data.position.as_ref())?;
        check_joints("torque", data.torque.as_ref())?;
        check_wrench("wrench", data.wrench.as_ref())?;
        check_transformations(&data.transformations)?;
        check_io(&data.io)
    }
}

/// Returns the datagram of a message.
///
/// # Errors
/// Returns [`WireError::Size`] if it is larger than a datagram may be.
pub fn encode<M: FriMessage>(version: Version, message: &M) -> Result<Vec<u8>, WireError> {
    let body = message.encode_to_vec();
    let bytes = match version.is_framed() {
        false => body,
        true => {
            let length = u32::try_from(body.len()).map_err(|_| WireError::Size(body.len()))?;
            let checksum = crc32fast::hash(&body).to_le_bytes();
            [length.to_le_bytes().as_slice(), &body, &checksum].concat()
        }
    };
    match bytes.len() <= DATAGRAM_MAX {
        true => Ok(bytes),
        false => Err(WireError::Size(bytes.len())),
    }
}

/// Reads a datagram. Numbers may be NaN or infinite, and values of enumerations unknown: the caller checks them.
///
/// # Errors
/// Returns why it is not the expected message of this version.
pub fn decode<M: FriMessage>(version: Version, bytes: &[u8]) -> Result<M, WireError> {
    if bytes.len() > DATAGRAM_MAX {
        return Err(WireError::Size(bytes.len()));
    }
    let result = decode_with(version.is_framed(), bytes);
    match result {
        Err(_) if decode_with::<M>(!version.is_framed(), bytes).is_ok() => {
            Err(WireError::OtherFrame(match version.is_framed() {
                true => "the message has no length and CRC: the peer speaks FRI 1.x or 2.5",
                false => "length and CRC stand around the message: the peer speaks FRI 2.7",
            }))
        }
        result => result,
    }
}

fn decode_with<M: FriMessage>(framed: bool, bytes: &[u8]) -> Result<M, WireError> {
    let body = if framed { unframe(bytes)? } else { bytes };
    let unreadable = |error: prost::DecodeError| WireError::Schema(error.to_string());
    // The header first: the other message's fields have other types.
    let envelope = Envelope::decode(body).map_err(unreadable)?;
    let header = envelope.header.ok_or(WireError::Missing("header"))?;
    let have = header.identifier.ok_or(WireError::Missing("identifier"))?;
    if have != M::IDENTITY {
        let want = M::IDENTITY;
        return Err(WireError::Identity { want, have });
    }
    header.sequence.ok_or(WireError::Missing("sequence"))?;
    header.reflected.ok_or(WireError::Missing("reflected"))?;
    let message = M::decode(body).map_err(unreadable)?;
    message.check()?;
    Ok(message)
}

/// Returns the message between its length and its CRC.
fn unframe(bytes: &[u8]) -> Result<&[u8], WireError> {
    let parts = bytes.split_first_chunk::<FRAME>();
    let parts = parts.and_then(|(length, rest)| Some((length, rest.split_last_chunk::<FRAME>()?)));
    let Some((length, (body, checksum))) = parts else {
        return Err(WireError::Size(bytes.len()));
    };
    let told = u32::from_le_bytes(*length) as usize;
    if told != body.len() {
        let have = body.len();
        return Err(WireError::Length { told, have });
    }
    let (told, computed) = (u32::from_le_bytes(*checksum), crc32fast::hash(body));
    match told == computed {
        true => Ok(body),
        false => Err(WireError::Checksum { told, computed }),
    }
}

fn check_joints(field: &'static str, values: Option<&JointValues>) -> Result<(), WireError> {
    let have = values.map_or(JOINTS, |values| values.value.len());
    exactly(field, have, JOINTS, "7")
}

fn check_wrench(
    field: &'static str,
    values: Option<&schema::CartesianVector>,
) -> Result<(), WireError> {
    exactly(
        field,
        values.map_or(6, |values| values.element.len()),
        6,
        "6",
    )
}

fn check_transformations(list: &[Transformation]) -> Result<(), WireError> {
    let most = TRANSFORMATIONS_MAX;
    at_most("transformations", list.len(), most, "at most 5")
}

fn check_io(list: &[IoValue]) -> Result<(), WireError> {
    at_most("io", list.len(), IO_MAX, "at most 10")?;
    for value in list {
        let name = value.name.as_ref().ok_or(WireError::Missing("io.name"))?;
        at_most("io.name", name.len(), IO_NAME_MAX, "at most 63 bytes")?;
        value.kind.ok_or(WireError::Missing("io.kind"))?;
        value.direction.ok_or(WireError::Missing("io.direction"))?;
    }
    Ok(())
}

fn exactly(
    field: &'static str,
    have: usize,
    count: usize,
    want: &'static str,
) -> Result<(), WireError> {
    match have == count {
        true => Ok(()),
        false => Err(WireError::Count { field, have, want }),
    }
}

fn at_most(
    field: &'static str,
    have: usize,
    most: usize,
    want: &'static str,
) -> Result<(), WireError> {
    match have <= most {
        true => Ok(()),
        false => Err(WireError::Count { field, have, want }),
    }
}

#[cfg(test)]
mod tests;
