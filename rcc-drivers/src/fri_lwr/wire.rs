//! Datagrams of KUKA LWR FRI 1.0, byte-exact, each defined by one table of fields.
//! Pure functions without allocation or unsafe code; run by whichever thread calls them.
//!
//! Little-endian, IEEE 754 binary32, natural alignment, no implicit padding. Layout: KUKA `friComm` revision 1.17, also
//! documented by Stanford's *Fast Research Interface Library* 1.2. A datagram of another size or identity belongs to
//! another layout version and is refused.

mod value;

use thiserror::Error;
use value::{WireValue, wire_enum};

/// Number of joints.
pub const JOINTS: usize = 7;
/// Size of a [`MeasurementDatagram`] in bytes.
pub const MSR_SIZE: usize = 916;
/// Size of a [`CommandDatagram`] in bytes.
pub const CMD_SIZE: usize = 376;
/// Identity of a [`MeasurementDatagram`]; doubles as the version of its layout.
pub const MSR_ID: u16 = 0x2006;
/// Identity of a [`CommandDatagram`]; doubles as the version of its layout.
pub const CMD_ID: u16 = 0x1005;

/// Bits of [`CommandDatagram::flags`]: they select the valid fields of the command. They may change in monitor state
/// only.
pub mod flags {
    /// `joint_position` is valid.
    pub const JOINT_POSITION: u32 = 0x0001;
    /// `additional_joint_torque` is valid.
    pub const JOINT_TORQUE: u32 = 0x0004;
    /// `joint_stiffness` is valid.
    pub const JOINT_STIFFNESS: u32 = 0x0010;
    /// `joint_damping` is valid.
    pub const JOINT_DAMPING: u32 = 0x0020;
    /// `cartesian_position` is valid.
    pub const CARTESIAN_POSITION: u32 = 0x0100;
    /// `additional_tcp_wrench` is valid.
    pub const TCP_WRENCH: u32 = 0x0400;
    /// `cartesian_stiffness` is valid.
    pub const CARTESIAN_STIFFNESS: u32 = 0x1000;
    /// `cartesian_damping` is valid.
    pub const CARTESIAN_DAMPING: u32 = 0x2000;
}

/// Why bytes are not the expected datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum WireError {
    /// The number of bytes is wrong.
    #[error("{datagram}: received {have} bytes, expected {want}; check the peer's FRI version")]
    Size {
        /// Name of the expected datagram.
        datagram: &'static str,
        /// Expected size in bytes.
        want: usize,
        /// Received size in bytes.
        have: usize,
    },
    /// `datagramId` belongs to another datagram or another version of the layout.
    #[error(
        "{datagram}: received identity {have:#06x}, expected {want:#06x}; check the peer's FRI version"
    )]
    Identity {
        /// Name of the expected datagram.
        datagram: &'static str,
        /// Expected identity.
        want: u16,
        /// Received identity.
        have: u16,
    },
    /// The field `packetSize` contradicts the datagram's size.
    #[error("{datagram}: the field packetSize is {have}, expected {want}")]
    PacketSize {
        /// Name of the expected datagram.
        datagram: &'static str,
        /// Expected content of the field.
        want: u16,
        /// Received content of the field.
        have: u16,
    },
    /// An enumeration field has an undefined value.
    #[error("field {field}: the value {value} is not defined in FRI 1.0")]
    UnknownValue {
        /// Name of the field in the layout.
        field: &'static str,
        /// Received value.
        value: u16,
    },
}

/// Expected identity and `packetSize` of a header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaderRule {
    /// Those of the datagram.
    Exact,
    /// Those of the datagram, or 0: some controllers do not fill them in. The size still tells the layout.
    Sparse,
}

/// One row of a layout: position and type of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name of the field.
    pub name: &'static str,
    /// Offset of the first byte.
    pub offset: usize,
    /// Type of one element: `u16`, `u32`, `i32` or `f32`.
    pub kind: &'static str,
    /// Number of elements.
    pub count: usize,
    /// Size of the whole field in bytes.
    pub size: usize,
}

wire_enum! {
    /// State of the interface.
    SessionState {
        /// Closed; never sent.
        #[default]
        Off = 0,
        /// Data is exchanged, but commands are not executed.
        Monitor = 1,
        /// Commands are executed.
        Command = 2,
    }
}

wire_enum! {
    /// Connection quality as rated by the controller; KUKA publishes no thresholds.
    Quality {
        /// Commanding is not allowed.
        #[default]
        Unacceptable = 0,
        /// The firmware allows commanding, but scripts do not start it.
        Bad = 1,
        /// Sufficient for commanding.
        Ok = 2,
        /// Nearly every answer arrives in time.
        Perfect = 3,
    }
}

wire_enum! {
    /// Control strategy chosen by the controller's program.
    FriControlStrategy {
        /// Any other strategy.
        #[default]
        Other = 0,
        /// Position control.
        Position = 1,
        /// Cartesian impedance control.
        CartesianImpedance = 2,
        /// Joint impedance control.
        JointImpedance = 3,
    }
}

/// Variables that are exchanged with the controller's KRL program, 16 of each type.
///
/// KRL counts from 1: `$FRI_TO_REA[1]` is `reals[0]`, `$FRI_TO_BOOL[1]` is bit 0 of `booleans`.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct KrlBlock {
    /// `$FRI_TO_REA` or `$FRI_FRM_REA`, no unit.
    pub reals: [f32; 16],
    /// `$FRI_TO_INT` or `$FRI_FRM_INT`.
    pub integers: [i32; 16],
    /// `$FRI_TO_BOOL` or `$FRI_FRM_BOOL`, bit i is number i + 1.
    pub booleans: u16,
}

impl KrlBlock {
    /// Returns KRL Boolean `number` (1 to 16); `None` outside that range.
    pub fn boolean(&self, number: usize) -> Option<bool> {
        (1..=16)
            .contains(&number)
            .then(|| self.booleans >> (number - 1) & 1 == 1)
    }

    /// Sets KRL Boolean `number` (1 to 16); returns false outside that range.
    pub fn set_boolean(&mut self, number: usize, value: bool) -> bool {
        let known = (1..=16).contains(&number);
        if known {
            let bit = 1 << (number - 1);
            self.booleans = if value {
                self.booleans | bit
            } else {
                self.booleans & !bit
            };
        }
        known
    }
}

/// Defines the structure, the layout and the codec of a datagram from one table. A row is `offset name: type`.
macro_rules! datagram {
    (
        $(#[$doc:meta])* $name:ident, $layout:ident, $size:ident, $id:ident, $title:literal;
        $($(#[$field_doc:meta])* $offset:literal $field:ident: $kind:ty;)*
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            /// Sender's own counter, incremented with each datagram; wraps from 65535 to 0.
            pub send_sequence: u16,
            /// The last `send_sequence` that the sender has received from its peer.
            pub reflected_sequence: u16,
            /// Variables of the KRL program.
            pub krl: KrlBlock,
            $($(#[$field_doc])* pub $field: $kind,)*
        }

        #[doc = concat!("All fields of a [`", stringify!($name), "`], in the order of the bytes, without gaps.")]
        pub const $layout: &[Field] = &[
            row::<u16>("send_sequence", 0),
            row::<u16>("reflected_sequence", 2),
            row::<u16>("packet_size", 4),
            row::<u16>("datagram_id", 6),
            row::<[f32; 16]>("krl.reals", 8),
            row::<[i32; 16]>("krl.integers", 72),
            row::<u16>("krl.booleans", 136),
            row::<u16>("krl.filler", 138),
            $(row::<$kind>(stringify!($field), $offset),)*
        ];
        const _: () = assert!(is_gapless($layout, $size));

        impl Default for $name {
            fn default() -> Self {
                Self {
                    send_sequence: 0,
                    reflected_sequence: 0,
                    krl: KrlBlock::default(),
                    $($field: <$kind as Zero>::ZERO,)*
                }
            }
        }

        impl $name {
            /// Encodes this datagram; size, identity and filler are added.
            pub fn encode(&self) -> [u8; $size] {
                let mut bytes = [0; $size];
                put(&mut bytes, 0, &self.send_sequence);
                put(&mut bytes, 2, &self.reflected_sequence);
                put(&mut bytes, 4, &($size as u16));
                put(&mut bytes, 6, &$id);
                put(&mut bytes, 8, &self.krl.reals);
                put(&mut bytes, 72, &self.krl.integers);
                put(&mut bytes, 136, &self.krl.booleans);
                $(put(&mut bytes, $offset, &self.$field);)*
                bytes
            }

            /// Decodes a datagram. Real values are not checked: they may be NaN or infinite.
            ///
            /// # Errors
            /// Returns an error for a wrong size, identity or `packetSize`, or an undefined value of an enumeration.
            pub fn decode(bytes: &[u8]) -> Result<Self, WireError> {
                Self::decode_as(bytes, HeaderRule::Exact)
            }

            /// As `decode`, with a rule for the header.
            ///
            /// # Errors
            /// As `decode`.
            pub fn decode_as(bytes: &[u8], rule: HeaderRule) -> Result<Self, WireError> {
                check_frame(bytes, $title, ($size, $id), rule)?;
                Ok(Self {
                    send_sequence: get(bytes, 0, "send_sequence")?,
                    reflected_sequence: get(bytes, 2, "reflected_sequence")?,
                    krl: KrlBlock {
                        reals: get(bytes, 8, "krl.reals")?,
                        integers: get(bytes, 72, "krl.integers")?,
                        booleans: get(bytes, 136, "krl.booleans")?,
                    },
                    $($field: get(bytes, $offset, stringify!($field))?,)*
                })
            }
        }
    };
}

datagram! {
    /// Datagram that the controller sends each cycle (KUKA: MSR, KRC to PC), 916 bytes.
    MeasurementDatagram, MSR_LAYOUT, MSR_SIZE, MSR_ID, "measurement datagram (MSR)";

    /// Time since the controller's start, s. Too coarse for time differences: count sequence numbers instead.
    140 timestamp: f32;
    /// State of the interface.
    144 state: SessionState;
    /// Connection quality.
    146 quality: Quality;
    /// Period of these datagrams, s.
    148 measurement_period: f32;
    /// Period of the expected answers, s.
    152 command_period: f32;
    /// Factor on the supervised limits, 0 to 1.
    156 safety_limits: f32;
    /// Answered share of the last 100 cycles, 0 to 1.
    160 answer_rate: f32;
    /// Mean delay of the answers, s.
    164 latency: f32;
    /// Jitter of that delay, s.
    168 jitter: f32;
    /// Missed share of the answers, averaged, 0 to 1.
    172 miss_rate: f32;
    /// Missed answers since the interface was opened.
    176 miss_count: u32;
    /// One bit per drive, 1 = powered.
    180 power: u16;
    /// Control strategy.
    182 control: FriControlStrategy;
    /// One bit per drive; an error removes the power.
    184 error: u16;
    /// One bit per drive.
    186 warning: u16;
    /// Temperature of the drives, in practice °C.
    188 temperature: [f32; JOINTS];
    /// Measured joint positions, rad.
    216 measured_position: [f32; JOINTS];
    /// Measured flange pose in the base frame, 3×4 row-major `[R|p]`, p in m.
    244 measured_pose: [f32; 12];
    /// Joint positions of the controller's own interpolator, rad.
    292 commanded_position: [f32; JOINTS];
    /// FRI's offset to `commanded_position`, rad; the joints are driven to the sum of both.
    320 commanded_position_offset: [f32; JOINTS];
    /// Pose at `commanded_position`, in the format of `measured_pose`.
    348 commanded_pose: [f32; 12];
    /// FRI's offset to `commanded_pose`, 3×4.
    396 commanded_pose_offset: [f32; 12];
    /// Measured joint torques, Nm.
    444 measured_torque: [f32; JOINTS];
    /// External joint torques, estimated with the controller's model, Nm.
    472 external_torque: [f32; JOINTS];
    /// Force and torque at the tool, N and Nm, in the order Fx Fy Fz Tz Ty Tx.
    500 external_tcp_wrench: [f32; 6];
    /// Jacobian, 6×7 row-major, rows X Y Z Rz Ry Rx.
    524 jacobian: [f32; 42];
    /// Joint-space mass matrix, 7×7, kg m².
    692 mass_matrix: [f32; 49];
    /// Joint torques caused by gravity, Nm.
    888 gravity: [f32; JOINTS];
}

datagram! {
    /// Datagram with which the PC answers in the same cycle (KUKA: CMD, PC to KRC), 376 bytes.
    CommandDatagram, CMD_LAYOUT, CMD_SIZE, CMD_ID, "command datagram (CMD)";

    /// Selects the valid fields below, see [`flags`].
    140 flags: u32;
    /// Desired joint positions, rad.
    144 joint_position: [f32; JOINTS];
    /// Desired pose in the base frame, 3×4 row-major `[R|p]`, p in m.
    172 cartesian_position: [f32; 12];
    /// Added joint torques, Nm.
    220 additional_joint_torque: [f32; JOINTS];
    /// Added force and torque at the tool, N and Nm, in the order Fx Fy Fz Tz Ty Tx.
    248 additional_tcp_wrench: [f32; 6];
    /// Joint stiffness, Nm/rad.
    272 joint_stiffness: [f32; JOINTS];
    /// Joint damping, normalised, 0 to 1.
    300 joint_damping: [f32; JOINTS];
    /// Cartesian stiffness, N/m and Nm/rad, in the order x y z Rz Ry Rx.
    328 cartesian_stiffness: [f32; 6];
    /// Cartesian damping, normalised, in the order x y z Rz Ry Rx.
    352 cartesian_damping: [f32; 6];
}

/// Initial value of a field.
trait Zero {
    const ZERO: Self;
}

macro_rules! zero {
    ($($kind:ty = $value:expr),*) => {$(impl Zero for $kind { const ZERO: Self = $value; })*};
}

zero!(
    u16 = 0,
    u32 = 0,
    f32 = 0.0,
    SessionState = SessionState::Off,
    Quality = Quality::Unacceptable,
    FriControlStrategy = FriControlStrategy::Other
);

impl<const N: usize> Zero for [f32; N] {
    const ZERO: Self = [0.0; N];
}

const fn row<T: WireValue>(name: &'static str, offset: usize) -> Field {
    Field {
        name,
        offset,
        kind: T::KIND,
        count: T::COUNT,
        size: T::SIZE,
    }
}

/// Checks that each field starts where the previous one ends, and that the last ends with the datagram.
const fn is_gapless(layout: &[Field], size: usize) -> bool {
    let (mut i, mut next) = (0, 0);
    while i < layout.len() {
        if layout[i].offset != next {
            return false;
        }
        next += layout[i].size;
        i += 1;
    }
    next == size
}

fn put<T: WireValue>(bytes: &mut [u8], offset: usize, value: &T) {
    value.put(&mut bytes[offset..offset + T::SIZE]);
}

fn get<T: WireValue>(bytes: &[u8], offset: usize, field: &'static str) -> Result<T, WireError> {
    T::get(&bytes[offset..offset + T::SIZE], field)
}

fn check_frame(
    bytes: &[u8],
    datagram: &'static str,
    (size, id): (usize, u16),
    rule: HeaderRule,
) -> Result<(), WireError> {
    let unfilled = |have: u16| have == 0 && rule == HeaderRule::Sparse;
    if bytes.len() != size {
        return Err(WireError::Size {
            datagram,
            want: size,
            have: bytes.len(),
        });
    }
    let have = get::<u16>(bytes, 6, "datagram_id")?;
    if have != id && !unfilled(have) {
        return Err(WireError::Identity {
            datagram,
            want: id,
            have,
        });
    }
    let (want, have) = (size as u16, get::<u16>(bytes, 4, "packet_size")?);
    if have != want && !unfilled(have) {
        return Err(WireError::PacketSize {
            datagram,
            want,
            have,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
