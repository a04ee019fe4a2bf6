//! Bodies about the state of a cell: its executor, its clock, its processes and their helpers.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

/// Status of the whole cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StatusView {
    /// The cell's name.
    pub cell: String,
    /// The configuration's file.
    pub config: String,
    /// Problems of the configuration, one sentence each: its files differ from what is in force, or processes were
    /// started with different configurations. Empty if there are none.
    #[serde(default)]
    pub configuration: Vec<String>,
    /// The executor.
    pub executor: ExecutorView,
    /// All announced processes.
    pub processes: Vec<ProcessView>,
    /// The helper threads of executor and loader.
    #[serde(default)]
    pub helpers: Vec<HelperView>,
}

/// A helper thread of a process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct HelperView {
    /// `executor` or `loader`.
    pub process: String,
    /// Its name.
    pub name: String,
    /// `waiting running hanging ended panicked`.
    pub state: String,
    /// Number of heartbeats (turns) so far.
    pub turns: u64,
    /// Time since the last turn, ns.
    pub age_ns: u64,
    /// Maximum time for a turn, ns: beyond it the process's heartbeat stops.
    pub limit_ns: u64,
}

/// A late cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct LateView {
    /// Number of the cycle.
    pub cycle: u64,
    /// `woken late` or `computed long`: the larger part of the lateness.
    pub cause: String,
    /// Delay of the wake-up after the deadline, ns.
    pub wake_ns: u64,
    /// Computing time of the cycle, ns.
    pub exec_ns: u64,
    /// Number of periods that were skipped.
    pub skipped_periods: u64,
    /// The net with the longest evaluation in it, if one ran.
    #[serde(default)]
    pub net: Option<String>,
    /// Duration of that evaluation, ns.
    pub net_ns: u64,
}

/// Answer to an acknowledgement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Acknowledged {
    /// Executor cycle from which worst values and histograms begin again.
    pub cycle: u64,
    /// Number of late cycles that were acknowledged.
    pub late: u64,
}

/// The executor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ExecutorView {
    /// Its process id.
    pub pid: u32,
    /// Incarnation of the process, 16 hexadecimal digits.
    pub incarnation: String,
    /// Number of the newest cycle; cycles are numbered from 1 without gaps.
    pub cycle: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// The time source of the cycles.
    pub clock: ClockView,
    /// Number of late cycles since its start.
    pub late: u64,
    /// Number of those that were acknowledged.
    #[serde(default)]
    pub late_acknowledged: u64,
    /// Number of late cycles since its start that woke late: the machine was busy, or did not run at all.
    #[serde(default)]
    pub late_woken: u64,
    /// Number of late cycles since its start that computed too long.
    #[serde(default)]
    pub late_computed: u64,
    /// First late cycle since the last acknowledgement.
    #[serde(default)]
    pub first_late: Option<LateView>,
    /// Last late cycle since the last acknowledgement.
    #[serde(default)]
    pub last_late: Option<LateView>,
    /// Longest delay of a wake-up since the last acknowledgement, ns.
    pub worst_wake_ns: u64,
    /// Computing time of the last cycle, ns.
    pub exec_last_ns: u64,
    /// Longest computing time of a cycle since the last acknowledgement, ns.
    pub exec_max_ns: u64,
    /// Time that all nets together may take in one cycle, ns; 0 if there is no limit.
    #[serde(default)]
    pub budget_ns: u64,
    /// Time that the running nets are expected to take together in one cycle, ns.
    #[serde(default)]
    pub committed_ns: u64,
    /// Number of periods skipped because of late cycles.
    pub skipped_periods: u64,
    /// Monitor records lost before they left the executor.
    pub dropped_records: u64,
    /// Number of recordings that the flight recorder handed over to be written to incident files, since its start.
    #[serde(default)]
    pub incidents: u64,
    /// Number of running commands.
    pub running: u32,
    /// SCHED_FIFO was granted.
    pub fifo: bool,
    /// Memory is locked.
    pub locked: bool,
    /// Pinned to a core.
    pub pinned: bool,
    /// `RT: granted (…)` or `RT: degraded, because …`.
    pub grade: String,
}

/// The time source of the executor's cycles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(default)]
pub struct ClockView {
    /// `own`; or `searching`, `locked` or `unfit` for a clock that follows a device.
    pub state: String,
    /// The device that it follows.
    pub device: Option<String>,
    /// Mean phase error of the cycles, ns.
    pub error_ns: f64,
    /// Mean deviation of the device's packets from their expected arrival, ns.
    pub jitter_ns: f64,
    /// Period of the device measured with the executor's clock, ns; 0 if not known.
    pub device_period_ns: f64,
    /// Deviation of that period from the nominal one, in millionths.
    pub rate_ppm: f64,
    /// Number of times that the lock was lost.
    pub losses: u64,
}

/// A process of the cell.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ProcessView {
    /// `executor`, `loader`, `driver`, …
    pub role: String,
    /// Label among the processes of this role.
    pub label: String,
    /// Its process id.
    pub pid: u32,
    /// Incarnation of the process, 16 hexadecimal digits.
    pub incarnation: String,
    /// False if the process is dead and nobody has cleaned up yet.
    pub alive: bool,
    /// Its note for people.
    pub note: String,
}
