//! The records that processes exchange through boards: plain data of fixed size, every bit pattern valid.
//!
//! Every record begins with `magic` (written once by its owner; 0 means never written), a sequence number and a
//! CLOCK_MONOTONIC stamp. Readers copy first, then check.

use bytemuck::{Pod, Zeroable};

pub use crate::joints::{JOINTS_MAX, Joints};

use crate::impedance::Impedance;
use crate::timing::LateCycle;

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

/// The state of a device, as reported by its driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DeviceState {
    /// The driver runs but cannot reach the device.
    Offline = 0,
    /// The device answers but cannot be commanded now.
    Online = 1,
    /// At rest at its hold set-point; a net may command it.
    Ready = 2,
    /// Follows a net's set-points.
    Commanded = 3,
    /// Being brought to rest by its driver.
    Stopping = 4,
}

impl DeviceState {
    /// All states, in order of their numbers.
    pub const ALL: [DeviceState; 5] = [
        DeviceState::Offline,
        DeviceState::Online,
        DeviceState::Ready,
        DeviceState::Commanded,
        DeviceState::Stopping,
    ];

    /// Returns the state of a number that came from another process; unknown numbers are `Offline`.
    pub fn from_number(number: u32) -> DeviceState {
        Self::ALL
            .get(number as usize)
            .copied()
            .unwrap_or(DeviceState::Offline)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        match self {
            DeviceState::Offline => "offline",
            DeviceState::Online => "online",
            DeviceState::Ready => "ready",
            DeviceState::Commanded => "commanded",
            DeviceState::Stopping => "stopping",
        }
    }
}

/// Driver → executor: the newest measurement of a device.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Measurement {
    /// [`MAGIC`].
    pub magic: u64,
    /// +1 for each exchange with the device.
    pub sequence: u64,
    /// CLOCK_MONOTONIC of that exchange.
    pub stamp_ns: u64,
    /// Periods of the device since its driver started, including those without an exchange.
    pub periods: u64,
    /// Period as reported by the device, ns; 0 = not known.
    pub period_ns: u64,
    /// [`DeviceState`].
    pub state: u32,
    /// Quality of the connection in thousandths, 1000 is best.
    pub quality_permille: u32,
    /// Reason why the device is not ready: a number that the driver's announcement explains, 0 = no reason.
    pub reason: u32,
    /// Number of joints, 0 for plain I/O.
    pub joints: u32,
    /// [`crate::impedance::ControlMode`] that the device runs, as a number.
    pub strategy: u64,
    /// Measured position, rad.
    pub position: Joints,
    /// The set-point that the driver currently sends, rad: a net's set-points as they are played, or the hold position
    /// while no net commands the device.
    pub hold: Joints,
    /// Measured torque, N·m.
    pub torque: Joints,
    /// Torque not explained by the dynamic model, N·m.
    pub external_torque: Joints,
    /// External force and torque at the flange `[fx fy fz tx ty tz]`, N and N·m, in the sensor frame of the device.
    pub wrench: [f64; 6],
    /// Bit i: digital input i.
    pub digital: u64,
    /// Bit i: digital input i is known.
    pub digital_known: u64,
    /// Analog inputs in SI units; NaN is unknown.
    pub analog: [f64; ANALOG_MAX],
    /// Bit i: value that the driver sends to digital output i, commanded or after release.
    pub digital_out: u64,
    /// Bit i: the driver sends a value to digital output i; an output with `on_release: hold` has none before the first
    /// command.
    pub digital_out_known: u64,
    /// Values that the driver sends to the analog outputs, SI units; NaN = none.
    pub analog_out: [f64; ANALOG_MAX],
    /// Incarnation of the executor whose board the driver follows, 0 = none.
    pub executor: u64,
    /// Logical time of the last set-point sent, ns.
    pub played_ns: u64,
    /// Logical time up to which all set-points have been played and the arm is at rest at `hold`, ns; 0 while it moves.
    pub settled_ns: u64,
    /// Number of set-points left to play when the last one was taken.
    pub margin: u64,
    /// Number of exchanges in which the driver answered late or lost an answer.
    pub late: u64,
    /// Number of refused datagrams (size, identity, order).
    pub refused: u64,
    /// Number of times that the driver had no fresh set-point while commanded.
    pub starved: u64,
}

/// The commands of one cycle for a device.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SetPoint {
    /// Logical time, ns: one period per evaluated cycle, independent of the wall clock.
    pub logical_ns: u64,
    /// Number of the engagement: counts up whenever a net takes the arm. 0 = none.
    pub owner: u64,
    /// 1 = `position` is a command; 0 = no command (null, or no net commands the arm).
    pub has_position: u64,
    /// Joint set-point, rad.
    pub position: Joints,
    /// Impedance; valid only with `position`.
    pub impedance: Impedance,
    /// Bit i: value of digital output i.
    pub digital: u64,
    /// Bit i: digital output i is commanded.
    pub digital_commanded: u64,
    /// Analog outputs in SI units; NaN = no command.
    pub analog: [f64; ANALOG_MAX],
}

impl SetPoint {
    /// No commands.
    pub const NONE: SetPoint = SetPoint {
        logical_ns: 0,
        owner: 0,
        has_position: 0,
        position: [0.0; JOINTS_MAX],
        impedance: Impedance::NONE,
        digital: 0,
        digital_commanded: 0,
        analog: [f64::NAN; ANALOG_MAX],
    };
}

/// Executor → driver: the source of the set-points, and the number of the newest.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CommandHead {
    /// [`MAGIC`].
    pub magic: u64,
    /// Incarnation of the executor.
    pub executor: u64,
    /// Number of evaluated cycles: the number of the newest set-point.
    pub sequence: u64,
    /// CLOCK_MONOTONIC at which the newest set-point was written.
    pub stamp_ns: u64,
    /// Period of the executor, ns.
    pub period_ns: u64,
    /// Sequence of the measurement that the newest set-point was computed from, 0 = none.
    pub seen: u64,
}

/// Executor → driver: the last set-points of a device. Each process keeps its own image; only the head and one
/// set-point per cycle are transferred.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CommandImage {
    /// Source of the set-points.
    pub head: CommandHead,
    /// Ring of the last cycles; the newest is `set_points[sequence % SET_POINTS]`.
    pub set_points: [SetPoint; SET_POINTS],
}

impl CommandImage {
    /// Returns the set-point of cycle `sequence` if the ring still has it; cycles count from 1.
    pub fn at(&self, sequence: u64) -> Option<&SetPoint> {
        let age = self.head.sequence.checked_sub(sequence)?;
        let place = (sequence % SET_POINTS as u64) as usize;
        let point = self.set_points.get(place)?;
        let is_it = Some(point.logical_ns) == sequence.checked_mul(self.head.period_ns);
        (sequence > 0 && age < SET_POINTS as u64 && is_it).then_some(point)
    }

    /// Creates the image of an executor that has written nothing yet.
    pub const fn new(executor: u64, period_ns: u64) -> CommandImage {
        CommandImage {
            head: CommandHead {
                magic: MAGIC,
                executor,
                sequence: 0,
                stamp_ns: 0,
                period_ns,
                seen: 0,
            },
            set_points: [SetPoint::NONE; SET_POINTS],
        }
    }

    /// Stores `point` as the newest set-point, of cycle `sequence`; its logical time is computed from the cycle.
    pub fn push(&mut self, sequence: u64, stamp_ns: u64, point: SetPoint) {
        (self.head.sequence, self.head.stamp_ns) = (sequence, stamp_ns);
        let logical_ns = sequence.wrapping_mul(self.head.period_ns);
        let point = SetPoint {
            logical_ns,
            ..point
        };
        self.keep(sequence, point);
    }

    /// Stores `point` unchanged in the place of cycle `sequence`.
    pub fn keep(&mut self, sequence: u64, point: SetPoint) {
        let place = (sequence % SET_POINTS as u64) as usize;
        if let Some(place) = self.set_points.get_mut(place) {
            *place = point;
        }
    }
}

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
    /// Evaluated every cycle.
    Running = 4,
    /// Evaluated every cycle; the output of its `Cancel` is true.
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
    /// Ended by ABORT.
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
    /// Joint, counted from 1; 0 = none.
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

/// One row of the device table.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct DeviceEntry {
    /// [`DeviceState`] as seen by the executor: `Offline` when the board is stale.
    pub state: u32,
    /// 1 = a driver's board is attached.
    pub attached: u32,
    /// Incarnation of the driver.
    pub incarnation: u64,
    /// Id of the command that holds the arm, 0 = none.
    pub holder: u64,
    /// Sequence of the newest measurement.
    pub sequence: u64,
    /// CLOCK_MONOTONIC of the newest measurement, ns.
    pub stamp_ns: u64,
    /// Quality of the connection in thousandths.
    pub quality_permille: u32,
    /// The driver's reason number.
    pub reason: u32,
    /// Number of times that the board became stale.
    pub losses: u64,
}

/// The source of the executor's cycle timing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ClockState {
    /// The executor's own clock.
    Own = 0,
    /// It follows a device that is silent, or whose phase has not been reached yet.
    Searching = 1,
    /// Its cycles begin at a fixed time after the device's packets.
    Locked = 2,
    /// It cannot follow, because the device's period is not a multiple of its own.
    Unfit = 3,
}

impl ClockState {
    /// All states, in order of their numbers, with their names.
    pub const ALL: [(ClockState, &'static str); 4] = [
        (ClockState::Own, "own"),
        (ClockState::Searching, "searching"),
        (ClockState::Locked, "locked"),
        (ClockState::Unfit, "unfit"),
    ];

    /// Converts a number that came from another process; unknown numbers give the first variant.
    pub fn from_number(number: u32) -> ClockState {
        Self::ALL
            .get(number as usize)
            .map_or(ClockState::Own, |row| row.0)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        Self::ALL.get(self as usize).map_or("own", |row| row.1)
    }
}

/// The state of the executor's clock relative to the device that it follows.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ClockStatus {
    /// [`ClockState`].
    pub state: u32,
    /// Device index, `u32::MAX` = none.
    pub device: u32,
    /// Mean time from the start of a cycle to its target, ns.
    pub error_ns: f64,
    /// Mean deviation of packets from their expected time, ns.
    pub jitter_ns: f64,
    /// The device's period measured with the executor's clock, ns; 0 = not known.
    pub device_period_ns: f64,
    /// Deviation of that period from nominal, positive if longer, in millionths.
    pub rate_ppm: f64,
    /// Number of times that the lock was lost.
    pub losses: u64,
}

impl ClockStatus {
    /// A clock that follows no device.
    pub const OWN: ClockStatus = ClockStatus {
        state: ClockState::Own as u32,
        device: u32::MAX,
        error_ns: 0.0,
        jitter_ns: 0.0,
        device_period_ns: 0.0,
        rate_ppm: 0.0,
        losses: 0,
    };
}

/// Executor → all processes: the counters of the cycle, written every cycle.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CycleStatus {
    /// [`MAGIC`].
    pub magic: u64,
    /// Incarnation of the executor.
    pub incarnation: u64,
    /// Number of this cycle, from 1, without gaps.
    pub cycle: u64,
    /// CLOCK_MONOTONIC at which the cycle woke.
    pub stamp_ns: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Number of cycles since the start that woke or ended after the next deadline.
    pub late: u64,
    /// Number of those that were acknowledged.
    pub late_acknowledged: u64,
    /// Number of late cycles since the start whose cause is [`crate::timing::LateCause::WokenLate`].
    pub late_woken: u64,
    /// Number of late cycles since the start whose cause is [`crate::timing::LateCause::ComputedLong`].
    pub late_computed: u64,
    /// First late cycle since the last acknowledgement (latched).
    pub first_late: LateCycle,
    /// Last late cycle since the last acknowledgement (latched).
    pub last_late: LateCycle,
    /// Largest wake-up latency since the last acknowledgement, ns.
    pub worst_wake_ns: u64,
    /// Computation time of the last cycle, ns.
    pub exec_last_ns: u64,
    /// Longest computation time of a cycle since the last acknowledgement, ns.
    pub exec_max_ns: u64,
    /// Time budget of all nets together in one cycle, ns; 0 = no limit.
    pub budget_ns: u64,
    /// Number of periods skipped because of late cycles.
    pub skipped_periods: u64,
    /// Number of records that did not fit into the ring to the pump thread.
    pub dropped_records: u64,
    /// Number of recordings that the flight recorder handed over to be written, since the start.
    pub incidents: u64,
    /// Number of commands running.
    pub running: u32,
    /// Bit 0 SCHED_FIFO, bit 1 memory locked, bit 2 pinned to a core.
    pub grants: u32,
    /// Source of the cycle timing.
    pub clock: ClockStatus,
}

/// Executor → all processes: the command and device tables, written when they change and at least every 16 ms.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Tables {
    /// [`MAGIC`].
    pub magic: u64,
    /// Cycle at which the tables were written.
    pub cycle: u64,
    /// Commands; rows with id 0 are free.
    pub commands: [CommandEntry; COMMANDS_MAX],
    /// Devices, in the order of the cell's configuration.
    pub devices: [DeviceEntry; DEVICES_MAX],
}

/// One monitored value, from the executor's pump to the monitors.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct MonitorRecord {
    /// Number of the record, counted over all records of this executor without gaps: a gap means loss.
    pub sequence: u64,
    /// Executor cycle.
    pub cycle: u64,
    /// CLOCK_MONOTONIC of that cycle.
    pub stamp_ns: u64,
    /// Command id.
    pub command: u64,
    /// Index of the monitor in the plan.
    pub monitor: u32,
    /// Number of elements used in `values`.
    pub width: u32,
    /// Values: `Real` unchanged; `Bool` as 0, 1, NaN = null; `Int` as its bit pattern.
    pub values: [f64; MONITOR_WIDTH_MAX],
}
