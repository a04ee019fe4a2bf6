//! Why the device is not ready, in numbers and words. Constant.

use rcc_driver_kit::host::reason::Reason;

use crate::session::{Loss, SessionError};

/// The network interface cannot be used.
pub const INTERFACE: u32 = 100;
/// No terminal answers.
pub const SILENT: u32 = 101;
/// The line is another one.
pub const WRONG_LINE: u32 = 102;
/// The line does not reach OP.
pub const START: u32 = 103;
/// The working counter is wrong.
pub const WORKING_COUNTER: u32 = 104;
/// A terminal has left OP.
pub const LEFT: u32 = 105;
/// The line is being started.
pub const STARTING: u32 = 106;
/// The thread of the line does not exist.
pub const THREAD: u32 = 107;
/// No net permits the drives.
pub const DRIVES_OFF: u32 = 108;
/// The drives are being enabled.
pub const DRIVES_ENABLING: u32 = 109;
/// A drive is in fault.
pub const DRIVE_FAULT: u32 = 110;
/// A drive has left `operation enabled`.
pub const DRIVE_LEFT: u32 = 111;
/// A drive was not enabled in time.
pub const DRIVE_START: u32 = 112;
/// The first set-point is not where the drives are.
pub const JUMP: u32 = 113;
/// The driver is ending.
pub const RELEASED: u32 = 114;

/// A set-point is further from the one before than a drive moves in some periods.
pub const LATE: u32 = 115;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        INTERFACE,
        "the network interface of settings.interface cannot be used: it must exist, and raw packets need CAP_NET_RAW",
    ),
    (
        SILENT,
        "no EtherCAT terminal answers: check the cable to settings.interface and the supply of the line",
    ),
    (
        WRONG_LINE,
        "the EtherCAT line is not that of settings.terminals; `rcc-cli doctor device` and the log name the difference",
    ),
    (
        START,
        "the EtherCAT line does not reach OP; `rcc-cli doctor device` and the log name the step",
    ),
    (
        WORKING_COUNTER,
        "an EtherCAT terminal takes no part in the exchange (wrong working counter): check cables and supply behind the last one that answers",
    ),
    (
        LEFT,
        "an EtherCAT terminal has left OP, and the line is started again; `rcc-cli doctor device` and the log name it",
    ),
    (STARTING, "the EtherCAT line is being started"),
    (
        THREAD,
        "the operating system refuses the thread of the EtherCAT line: see `ulimit -u`",
    ),
    (
        DRIVES_OFF,
        "the drives are off: a net must switch the output with the address `axes enable` on",
    ),
    (DRIVES_ENABLING, "the drives are being enabled"),
    (
        DRIVE_FAULT,
        "a drive is in fault; `rcc-cli doctor device` names it with its error code. Remove the cause, then switch the output with the address `axes enable` off and on: that resets the fault. Without such an output, reset it at the drive and restart the driver",
    ),
    (
        DRIVE_LEFT,
        "a drive has left `operation enabled` by itself: check safe torque off and the supply of the motor, then switch the output with the address `axes enable` off and on, or restart the driver if there is none",
    ),
    (
        DRIVE_START,
        "a drive was not enabled within 5 s; `rcc-cli doctor device` names its state: check safe torque off and the supply of the motor, then switch the output with the address `axes enable` off and on, or restart the driver if there is none",
    ),
    (
        JUMP,
        "the first set-point is further from the position of a drive than `following_window`, or one is no number: the drives were stopped; switch the output with the address `axes enable` off and on, or restart the driver if there is none",
    ),
    (
        RELEASED,
        "the driver has switched the drives off and is ending",
    ),
    (
        LATE,
        "the driver was away for several periods while the drives moved, or exchanges were lost: the drives were stopped, since the way of these periods cannot be made up for in one; check the load of this machine and the line, then switch the output with the address `axes enable` off and on",
    ),
];

/// Returns the reason of a session that has ended.
#[must_use]
pub fn of(error: &SessionError) -> u32 {
    match error {
        SessionError::Nic(_) | SessionError::Network(_) => INTERFACE,
        SessionError::NoAnswer { .. } => SILENT,
        SessionError::Count { .. }
        | SessionError::Terminal { .. }
        | SessionError::Object { .. }
        | SessionError::NoClock
        | SessionError::NoSync { .. }
        | SessionError::Image(_) => WRONG_LINE,
        SessionError::Start { .. } => START,
        SessionError::Left { .. } | SessionError::Restarted => LEFT,
    }
}

/// Returns the reason of lost exchanges.
#[must_use]
pub fn of_loss(loss: Loss) -> u32 {
    match loss {
        Loss::Silent => SILENT,
        Loss::WorkingCounter { .. } => WORKING_COUNTER,
        Loss::Starting => STARTING,
        Loss::Unconfirmed => LEFT,
    }
}
