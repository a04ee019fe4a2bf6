//! State of a command, how it ended, and its entry in the executor's table.

use bytemuck::{Pod, Zeroable};

/// The state of a command: figure 2 of Vistein et al. 2010, plus `rejected`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum CommandState {
    /// The row is free.
    None = 0,
    /// The loader is processing it.
    Loading = 1,
    /// The loader or the executor refused it.
    Rejected = 2,
    /// It can be started.
    Ready = 3,
    /// Evaluated in every cycle in which its rate is due.
    Running = 4,
    /// As `Running`; the output of its `Cancel` is true.
    Canceling = 5,
    /// Terminated; see [`EndReason`].
    Terminated = 6,
}

/// Why a command terminated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum EndReason {
    /// Not terminated.
    None = 0,
    /// The input of its `Termination` was true.
    Finished = 1,
    /// The input of its `Termination` was true after CANCEL.
    Canceled = 2,
    /// Ended without its `Termination`: by ABORT, a hand-over, a rule, or, without a `Cancel`, a lost lease or the stop
    /// of the executor.
    Aborted = 3,
    /// Ended by a fault; see [`FaultRecord`].
    Fault = 4,
}

impl CommandState {
    /// All states, in order of their numbers.
    pub const ALL: [(CommandState, &'static str); 7] = [
        (CommandState::None, "none"),
        (CommandState::Loading, "loading"),
        (CommandState::Rejected, "rejected"),
        (CommandState::Ready, "ready"),
        (CommandState::Running, "running"),
        (CommandState::Canceling, "canceling"),
        (CommandState::Terminated, "terminated"),
    ];

    /// Converts a number that came from another process; unknown numbers give the first variant.
    pub fn from_number(number: u32) -> CommandState {
        Self::ALL
            .get(number as usize)
            .map_or(CommandState::None, |row| row.0)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("none", |row| row.1)
    }

    /// Returns true for `Running` and `Canceling`.
    pub fn is_active(self) -> bool {
        matches!(self, CommandState::Running | CommandState::Canceling)
    }
}

impl EndReason {
    /// All reasons, in order of their numbers.
    pub const ALL: [(EndReason, &'static str); 5] = [
        (EndReason::None, "none"),
        (EndReason::Finished, "finished"),
        (EndReason::Canceled, "canceled"),
        (EndReason::Aborted, "aborted"),
        (EndReason::Fault, "fault"),
    ];

    /// Converts a number that came from another process; unknown numbers give the first variant.
    pub fn from_number(number: u32) -> EndReason {
        Self::ALL
            .get(number as usize)
            .map_or(EndReason::None, |row| row.0)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("none", |row| row.1)
    }
}

/// The fault for which the executor ended a net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum FaultCode {
    /// No fault.
    None = 0,
    /// A device that the net commands is lost, or cannot be commanded.
    DeviceLost = 1,
    /// A set-point did not start at the hold set-point.
    Jump = 2,
    /// A set-point was not finite, or outside the limits.
    Limit = 3,
    /// A primitive panicked.
    Panic = 4,
    /// A motion could not be computed.
    Motion = 5,
    /// Too many late cycles in a row.
    Overrun = 6,
}

impl FaultCode {
    /// All codes, in order of their numbers, with their names.
    pub const ALL: [(FaultCode, &'static str); 7] = [
        (FaultCode::None, "none"),
        (FaultCode::DeviceLost, "device lost"),
        (FaultCode::Jump, "jump"),
        (FaultCode::Limit, "limit"),
        (FaultCode::Panic, "panic"),
        (FaultCode::Motion, "motion"),
        (FaultCode::Overrun, "overrun"),
    ];

    /// Converts a number that came from another process; unknown numbers give the first variant.
    pub fn from_number(number: u32) -> FaultCode {
        Self::ALL
            .get(number as usize)
            .map_or(FaultCode::None, |row| row.0)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("none", |row| row.1)
    }
}

/// A fault with its values.
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq)]
#[repr(C)]
pub struct FaultRecord {
    /// [`FaultCode`].
    pub code: u32,
    /// Device index, `u32::MAX` = none.
    pub device: u32,
    /// Joint, counted from 1; 0 = none. Numbers above [`crate::joints::JOINTS_MAX`] are axes, see [`crate::guard::axis`].
    pub joint: u32,
    /// [`crate::guard::ViolationKind`] as a number, 0 = none.
    pub violation: u32,
    /// Requested value, SI units.
    pub value: f64,
    /// Allowed value (a limit) or expected value (the hold set-point), SI units.
    pub limit: f64,
    /// Executor cycle.
    pub cycle: u64,
}

impl FaultRecord {
    /// No fault.
    pub const NONE: FaultRecord = FaultRecord {
        code: 0,
        device: u32::MAX,
        joint: 0,
        violation: 0,
        value: 0.0,
        limit: 0.0,
        cycle: 0,
    };
}

/// One row of the command table.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CommandEntry {
    /// Id, 0 = free row.
    pub id: u64,
    /// [`CommandState`].
    pub state: u32,
    /// [`EndReason`].
    pub reason: u32,
    /// Fault, if any.
    pub fault: FaultRecord,
    /// Number of cycles evaluated since START.
    pub cycles: u64,
    /// Executor cycle of the first evaluation.
    pub started_cycle: u64,
    /// Executor cycle of the last evaluation.
    pub ended_cycle: u64,
    /// Duration of the last evaluation, ns.
    pub exec_last_ns: u64,
    /// Duration of the longest evaluation, ns.
    pub exec_max_ns: u64,
    /// Total duration of all evaluations, ns.
    pub exec_sum_ns: u64,
    /// Expected duration of one evaluation on this machine, ns; 0 = not known.
    pub expected_ns: u64,
    /// 1 = it has a `Cancel` primitive.
    pub can_cancel: u32,
    /// The condition of its `Termination` that ended it, counted from 1 in the order of the text; 0 = none.
    pub outcome: u32,
}
