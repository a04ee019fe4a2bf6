//! What the executor publishes in each cycle: the tables of commands and devices, its clock, and the records of monitors.

use bytemuck::{Pod, Zeroable};

use super::command::CommandEntry;
use super::{COMMANDS_MAX, DEVICES_MAX, MONITOR_WIDTH_MAX};
use crate::timing::LateCycle;

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
    /// Number of times that the device was lost: its board stale, detached or implausible.
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
