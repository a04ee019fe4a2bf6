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
