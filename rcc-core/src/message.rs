//! The records that processes exchange through boards, rings and streams: plain data of fixed size, every bit pattern
//! valid.
//!
//! Each record of a board begins with `magic` (written once by its owner; 0 means never written). `Measurement`,
//! `CommandHead` and `CycleStatus` also carry a sequence or cycle number and a CLOCK_MONOTONIC stamp; `Tables` and
//! `CycleTiming` carry the cycle. Readers copy first, then check.

mod command;
mod device;
mod status;

pub use crate::joints::{JOINTS_MAX, Joints};
pub use command::{CommandEntry, CommandState, EndReason, FaultCode, FaultRecord};
pub use device::{CommandHead, CommandImage, DeviceState, Measurement, SetPoint};
pub use status::{ClockState, ClockStatus, CycleStatus, DeviceEntry, MonitorRecord, Tables};

/// Maximum number of digital channels of a device, per direction.
pub const DIGITAL_MAX: usize = 64;
/// Maximum number of analog channels of a device, per direction.
pub const ANALOG_MAX: usize = 16;
/// Number of set-points that the command board keeps for a driver: the number of cycles that a driver may miss.
pub const SET_POINTS: usize = 256;
/// Maximum number of devices of a cell.
pub const DEVICES_MAX: usize = 16;
/// Maximum number of commands at a time.
pub const COMMANDS_MAX: usize = 64;
/// Maximum number of elements of a monitored value.
pub const MONITOR_WIDTH_MAX: usize = 16;
/// Identifies this record layout; change it with the layout.
pub const MAGIC: u64 = u64::from_le_bytes(*b"rcc-v006");
