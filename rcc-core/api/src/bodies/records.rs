//! Bodies about what a cell has recorded: events of its log, monitored values, and incidents of the flight recorder.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

/// Events of the cell's log, in the order of the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct EventPage {
    /// The events.
    pub events: Vec<EventView>,
    /// Position after the last of them: the value of `after` for the events that follow.
    pub next: String,
    /// False if events between `after` and the first of these are missing or repeated: there were more than the loader
    /// keeps, or the loader was restarted.
    pub continues: bool,
}

/// An event of the cell's log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct EventView {
    /// Wall time, UTC: `2026-11-21T16:02:03.123456Z`.
    pub time: String,
    /// CLOCK_MONOTONIC of the cell's machine, ns.
    pub monotonic_ns: u64,
    /// Executor cycle, if the event belongs to one.
    pub cycle: Option<u64>,
    /// Its writer.
    pub source: EventSourceView,
    /// `info`, `warning` or `error`.
    pub severity: String,
    /// Its kind, a row of the table in `docs/events.md`.
    pub kind: String,
    /// The fields of this kind.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub fields: serde_json::Value,
    /// The event in one sentence, for people.
    #[serde(default)]
    pub words: String,
    /// The net concerned, as `net#id`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub net: Option<String>,
    /// Name of the outcome with which it finished, if its net names its outcomes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<String>,
}

/// The process that wrote an event.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct EventSourceView {
    /// `executor`, `loader`, `driver`, …
    pub role: String,
    /// Distinguishes processes of one role; for a driver, the name of its device.
    pub label: String,
    /// Process id.
    pub pid: u32,
    /// Incarnation of the process, 16 hexadecimal digits.
    pub incarnation: String,
}

/// Monitored values, in the order in which the executor published them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct HistoryPage {
    /// The values.
    pub values: Vec<MonitoredValue>,
    /// Position after the last of them: the value of `after` for the values that follow.
    pub next: String,
    /// False if values between `after` and the first of these are missing: the loader keeps no more, or the executor or
    /// the loader was restarted.
    pub continues: bool,
    /// Number of records, of any port, that were lost within this part of the history because the machine was too slow.
    pub lost: u64,
}

/// A value that a `Monitor` published.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct MonitoredValue {
    /// `net/primitive.port`, or one element of it.
    pub name: String,
    /// The net's name.
    pub net: String,
    /// The command's id.
    pub command: u64,
    /// The monitored port, `primitive.port`.
    pub source: String,
    /// Id of the `Monitor` primitive.
    pub monitor: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit, if the type does not imply it.
    pub unit: Option<String>,
    /// Number of the record, counted over all records of the executor.
    pub sequence: u64,
    /// Executor cycle.
    pub cycle: u64,
    /// CLOCK_MONOTONIC of that cycle on the cell's machine, ns.
    pub stamp_ns: u64,
    /// The value, or the list of its elements; null is null.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub value: serde_json::Value,
}

/// An incident file of the flight recorder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(default)]
pub struct IncidentView {
    /// Path on the cell's machine; its last part is the name for `GET /incidents/{file}`.
    pub file: String,
    /// Title of the net that caused it, such as `line#3`.
    pub name: Option<String>,
    /// Recorded time, s.
    pub span_s: f64,
    /// Version of the file's format.
    pub format: u32,
    /// Version of the executor.
    pub build: String,
    /// Version of the layout of data in shared memory.
    pub layout: String,
    /// Fingerprint of the catalogue of primitives, 16 hexadecimal digits.
    pub catalogue: String,
    /// Fingerprint of the devices' configuration, 16 hexadecimal digits.
    pub configuration: String,
    /// Name of the cell.
    pub cell: String,
    /// Path of the cell's configuration file.
    pub config: String,
    /// Incarnation of the executor, 16 hexadecimal digits.
    pub executor: String,
    /// Base period, ns.
    pub period_ns: u64,
    /// Names of the devices, in order of their index.
    pub devices: Vec<String>,
    /// `fault`, `late`, `request` or `trigger`.
    pub reason: String,
    /// Id of the net that ended with the fault, if the reason is one.
    pub net: Option<u64>,
    /// The fault in words, without names, if the reason is one.
    pub fault: Option<String>,
    /// The condition of a rule that became true, if the reason is a trigger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
    /// Cycle in which the recording was triggered.
    pub cycle: u64,
    /// Wall-clock time of the trigger, UTC.
    pub time: String,
    /// Number of further triggers in this recording.
    pub others: u64,
    /// First recorded cycle.
    pub first_cycle: u64,
    /// Last recorded cycle.
    pub last_cycle: u64,
    /// Ids of nets that were evaluated and whose plan is in the file.
    pub nets: Vec<u64>,
    /// Ids of nets that were evaluated and whose plan was no longer available when the file was written.
    pub without_plan: Vec<u64>,
}

/// Answer to a request for an incident file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Frozen))]
pub struct WrittenIncident {
    /// Executor cycle in which the recording was frozen; the file contains the seconds before it and a short time after
    /// it.
    pub cycle: u64,
    /// Incarnation of the executor, 16 hexadecimal digits: the file's name begins with it.
    pub executor: String,
    /// Path of the complete file.
    pub file: String,
}
