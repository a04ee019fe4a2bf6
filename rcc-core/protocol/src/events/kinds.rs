//! The kinds of events and their fields: one table that generates the type, the names and the documentation. Plain
//! data.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::EventSeverity;

/// One row of the table of event kinds, as in `docs/events.md`.
#[derive(Clone, Copy, Debug)]
pub struct EventKindRow {
    /// Name in the log.
    pub name: &'static str,
    /// Processes that write it.
    pub writer: &'static str,
    /// Usual severity.
    pub severity: EventSeverity,
    /// One-sentence description.
    pub summary: &'static str,
    /// Names of its fields.
    pub fields: &'static [&'static str],
}

macro_rules! kinds {
    ($(
        #[doc = $doc:literal]
        $name:ident = $text:literal, $writer:literal, $severity:ident {
            $($(#[$about:meta])* $field:ident: $type:ty,)*
        }
    )*) => {
        /// An event with its fields.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind", content = "fields")]
        pub enum EventKind {
            $(#[doc = $doc] #[serde(rename = $text)] $name { $($(#[$about])* $field: $type,)* },)*
        }

        /// All kinds of events.
        pub const EVENT_KINDS: &[EventKindRow] = &[$(EventKindRow {
            name: $text,
            writer: $writer,
            severity: EventSeverity::$severity,
            summary: $doc,
            fields: &[$(stringify!($field)),*],
        }),*];

        impl EventKind {
            /// Returns the name of the kind in the log.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self {
                    $(EventKind::$name { .. } => $text,)*
                }
            }

            fn usual_severity(&self) -> EventSeverity {
                match self {
                    $(EventKind::$name { .. } => EventSeverity::$severity,)*
                }
            }
        }
    };
}

kinds! {
    /// A process of the cell is ready; names the dead predecessor that it replaces, if any.
    Started = "started", "every process", Info {
        /// For people; the executor gives its real-time grade.
        note: String,
        /// The dead process with the same role and label, if any.
        predecessor: Option<Predecessor>,
    }
    /// A process of the cell ends on request.
    Stopping = "stopping", "every process", Info {
        /// Source of the request.
        why: String,
    }
    /// A helper thread of a process panicked or ended by itself: the process brings everything to rest and exits.
    HelperEnded = "helper-ended", "every process", Error {
        /// Name of the thread and how it ended.
        why: String,
    }
    /// A helper thread of a process makes no progress: the heartbeat stops, so that the supervisor ends the process.
    HelperHangs = "helper-hangs", "every process", Error {
        /// Name of the thread.
        helper: String,
        /// Time without progress, ms.
        silent_ms: u64,
        /// Allowed time without progress, ms.
        limit_ms: u64,
    }
    /// It could not be determined whether another process is alive; no action was taken, and the check is repeated.
    LifeUnknown = "life-unknown", "every process", Warning {
        /// The other process: executor, driver/lwr.
        process: String,
        /// Error from the system.
        why: String,
    }
    /// Events were not written because there were too many at once, or because the log could not be written.
    Suppressed = "suppressed", "every process", Warning {
        /// Number of lost events.
        count: u64,
    }
    /// A command changed its state; a terminated one has a reason, a fault its values.
    Command = "command", "executor", Info {
        /// Command id in this incarnation of the executor.
        command: u64,
        /// loading, rejected, ready, running, canceling or terminated.
        state: String,
        /// finished, canceled, aborted or fault.
        reason: Option<String>,
        /// The condition of its Termination that ended it, counted from 1 in the order of the text; absent if none did.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        outcome: Option<u32>,
        /// Number of cycles in which it was evaluated, of a terminated command.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        cycles: Option<u64>,
        /// Details of a fault.
        fault: Option<CommandFault>,
    }
    /// A device is lost: its ports are null from this cycle on.
    DeviceLost = "device-lost", "executor", Error {
        /// Name of the device.
        device: String,
        /// Age of the driver's last measurement, µs; absent if it is recent and the driver itself reports the loss.
        board_age_us: Option<u64>,
        /// Incarnation of the driver.
        driver: Option<String>,
        /// Reason, if known.
        reason: String,
    }
    /// A device is available: its ports have values from this cycle on. No net commands it until START.
    DeviceFound = "device-found", "executor", Info {
        /// Name of the device.
        device: String,
        /// online, ready, commanded or stopping.
        state: String,
        /// Incarnation of the driver.
        driver: Option<String>,
    }
    /// The state of a device changed, as seen by the executor.
    DeviceState = "device-state", "executor", Info {
        /// Name of the device.
        device: String,
        /// New state.
        state: String,
        /// Previous state.
        was: String,
        /// Reason given by the driver.
        reason: String,
    }
    /// The executor reads the boards of a new incarnation of a driver.
    DriverAttached = "driver-attached", "executor", Info {
        /// Name of the device.
        device: String,
        /// Process id of the driver.
        pid: u32,
        /// Incarnation of the driver.
        driver: String,
    }
    /// The executor found a driver dead.
    DriverGone = "driver-gone", "executor", Warning {
        /// Name of the device.
        device: String,
        /// Incarnation of the driver.
        driver: String,
    }
    /// A process was built from another version than this one: they refuse to work together.
    BuildMismatch = "other-build", "executor, driver, loader", Error {
        /// The other process: `driver io`, `executor`.
        process: String,
        /// Its process id.
        pid: u32,
        /// Incarnation of that process.
        life: String,
        /// Version and layout of both.
        differs: String,
        /// Remedy.
        remedy: String,
    }
    /// A process was started with another configuration than this one: they refuse to work together.
    ConfigurationMismatch = "other-configuration", "executor, driver, loader", Error {
        /// The other process: `driver io`, `executor`.
        process: String,
        /// Its process id.
        pid: u32,
        /// Incarnation of that process.
        life: String,
        /// Differences between the configurations, as far as known.
        differs: String,
        /// Remedy.
        remedy: String,
    }
    /// The configuration files differ from what the cell was started with, or match it again.
    ConfigurationChanged = "configuration-changed", "loader", Warning {
        /// Changes that are not in force; empty if the files match again.
        differs: String,
        /// The first fault, if no process could be started with the files now.
        fault: Option<String>,
    }
    /// Cycles were late; at most one line per second.
    Late = "late", "executor", Warning {
        /// Number of late cycles since the last line.
        count: u64,
        /// Number of the first of them.
        first_cycle: u64,
        /// Longest time from a deadline to the wake-up, µs.
        worst_wake_us: f64,
        /// Longest evaluation, µs.
        worst_exec_us: f64,
        /// Number of cycles that are late because of a long computation; the others were woken late.
        computed_long: Option<u64>,
        /// Command with the longest computation in one of these cycles.
        command: Option<u64>,
        /// Its computation time, µs.
        command_us: Option<f64>,
    }
    /// Late cycles were acknowledged: what was latched is cleared.
    Acknowledged = "acknowledged", "executor", Info {
        /// Number of acknowledged cycles.
        late: u64,
    }
    /// A rule fired, was refused, expired or was disarmed.
    Rule = "rule", "executor", Info {
        /// Id of the rule in this incarnation of the executor.
        rule: u64,
        /// fired, refused, expired or disarmed.
        state: String,
        /// Command that it was refused for, or that was stopped.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u64>,
        /// Reason; empty if it fired.
        why: String,
    }
    /// A lease expired or was ended: its client is gone.
    LeaseLost = "lease-lost", "executor", Warning {
        /// Id of the lease in this incarnation of the executor.
        lease: u64,
        /// Number of rules that were disarmed.
        rules: u32,
        /// Number of commands that were canceled or aborted.
        commands: u32,
    }
    /// The flight recorder wrote its last seconds to a file (`rcc-cli incidents`, `rcc-cli replay`).
    IncidentWritten = "incident-written", "executor", Warning {
        /// fault, late, request or trigger.
        reason: String,
        /// Command that caused it, if any.
        command: Option<u64>,
        /// Path of the file.
        file: String,
        /// Recorded time, ms.
        span_ms: u64,
        /// Number of further faults in the same file.
        others: u64,
    }
    /// The last seconds of the flight recorder could not be written and are lost.
    IncidentLost = "incident-lost", "executor", Error {
        /// Reason.
        why: String,
    }
    /// A text was compiled and its plan is sent to the executor; names the command.
    Loaded = "loaded", "loader", Info {
        /// Command id.
        command: u64,
        /// Incarnation of the executor.
        executor: String,
        /// Name of the net.
        net: String,
        /// Number of primitives.
        primitives: u32,
        /// Devices and topics that the net uses.
        uses: Vec<String>,
        /// Names of the outcomes of its Termination, in the order of the text.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        outcomes: Vec<String>,
    }
    /// A LOAD was rejected by the compiler, the loader or the executor; gives the first cause.
    Rejected = "rejected", "loader", Warning {
        /// Command id.
        command: u64,
        /// Incarnation of the executor.
        executor: String,
        /// Name of the net, if the text gives it.
        net: String,
        /// Code of the first fault.
        code: String,
        /// Message of the first fault.
        words: String,
        /// Number of faults.
        count: usize,
    }
    /// The loader works with this incarnation of the executor.
    ExecutorFound = "executor-found", "loader", Info {
        /// Process id.
        pid: u32,
        /// Incarnation.
        executor: String,
    }
    /// The loader found the executor dead: all its commands are lost.
    ExecutorLost = "executor-lost", "loader", Error {
        /// Process id.
        pid: u32,
        /// Incarnation.
        executor: String,
    }
    /// The loader disconnected a client.
    ClientCutOff = "client-cut-off", "loader", Warning {
        /// The client, as far as known.
        client: String,
        /// Reason.
        why: String,
    }
    /// The state of a device changed, as seen by its driver.
    DriverState = "driver-state", "driver", Info {
        /// New state.
        state: String,
        /// Previous state.
        was: String,
        /// Reason why it is not ready.
        reason: String,
    }
    /// The quality of the connection to a device changed noticeably.
    Quality = "quality", "driver", Info {
        /// Quality in thousandths; 1000 is best.
        permille: u32,
        /// Previous quality.
        was: u32,
    }
    /// A driver brings its device to rest by itself.
    RestBegun = "rest-begun", "driver", Warning {
        /// Reason.
        reason: String,
    }
    /// A device that a driver brought to rest has come to rest.
    RestReached = "rest-reached", "driver", Info {
        /// Duration of the stop, ms.
        after_ms: u64,
    }
    /// A driver refused a set-point.
    Refused = "refused", "driver", Error {
        /// Joint, from 1; 0 if no joint is concerned, see `words`.
        joint: u32,
        /// Commanded value.
        value: Option<f64>,
        /// Allowed value.
        limit: Option<f64>,
        /// Unit of both values.
        unit: String,
        /// Description of the violated rule.
        words: String,
    }
    /// Analog outputs were commanded out of range and are released instead.
    OutOfRange = "out-of-range", "driver", Error {
        /// Names of the channels.
        channels: Vec<String>,
        /// Each channel with the commanded value and its range.
        words: String,
    }
    /// A run of the cell begins.
    CellStarted = "cell-started", "supervisor", Info {
        /// Path of the configuration.
        config: String,
        /// Ports of this run.
        ports: BTreeMap<String, u16>,
        /// The last event of the previous run, if that did not end in order.
        previous: Option<LastEvent>,
    }
    /// The cell is being stopped.
    CellStopping = "cell-stopping", "supervisor", Info {
        /// Source of the request.
        why: String,
    }
    /// The cell has ended in order; the log goes on with the next run.
    CellEnded = "cell-ended", "supervisor", Info {
        /// Folder in which its events, incidents and logs stay.
        kept: String,
    }
    /// A process was started.
    ProcessStarted = "process-started", "supervisor", Info {
        /// Name of the process: executor, loader, driver/lwr, simulator/lwr-sim.
        process: String,
        /// Its process id.
        pid: u32,
    }
    /// A process died.
    ProcessDied = "process-died", "supervisor", Error {
        /// Name of the process.
        process: String,
        /// Its process id.
        pid: u32,
        /// Signal or exit code.
        how: String,
        /// Last line that it wrote.
        last_words: String,
    }
    /// A process that died is restarted.
    ProcessRestart = "process-restart", "supervisor", Warning {
        /// Name of the process.
        process: String,
        /// Number of restarts within the time window, this one included.
        nth: usize,
        /// Maximum number of restarts within the window.
        most: usize,
        /// Time window, s.
        within_s: u64,
    }
    /// A process is not restarted any more.
    ProcessFailed = "process-failed", "supervisor", Error {
        /// Name of the process.
        process: String,
        /// Reason.
        why: String,
    }
    /// A process was killed because its heartbeat stopped.
    WatchdogKill = "watchdog-kill", "supervisor", Error {
        /// Name of the process.
        process: String,
        /// Its process id.
        pid: u32,
        /// Time since the last heartbeat, ms.
        silent_ms: u64,
    }
    /// Leftovers of dead processes were removed.
    Cleaned = "cleaned", "janitor", Info {
        /// Number of half-created files.
        half_created: usize,
        /// Number of dead nodes.
        dead_nodes: u64,
        /// Number of other files.
        files: usize,
        /// Dead processes, as far as their announcements identify them.
        of: Vec<String>,
    }
    /// A fault was injected on purpose (`rcc-cli fault`).
    FaultInjected = "fault-injected", "cli", Warning {
        /// Device or process.
        target: String,
        /// The injected fault.
        what: String,
    }
}

/// A dead process that another one replaces.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Predecessor {
    /// Its process id.
    pub pid: u32,
    /// Incarnation, 16 hexadecimal digits.
    pub incarnation: String,
}

/// The last event of a run of the cell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastEvent {
    // `time` must not be the first field: only a line of the log begins with it.
    /// Process that wrote it.
    pub who: String,
    /// Its time.
    pub time: String,
    /// Its sentence.
    pub words: String,
}

/// Reason why a net was ended by a fault, with the values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommandFault {
    /// device lost, jump, limit, panic, motion, overrun.
    pub code: String,
    /// Name of the device.
    pub device: Option<String>,
    /// The joint, from 1.
    pub joint: Option<u32>,
    /// The violated rule.
    pub rule: Option<String>,
    /// Commanded value, SI.
    pub value: Option<f64>,
    /// Allowed value, SI.
    pub limit: Option<f64>,
    /// Unit of both values.
    pub unit: Option<String>,
}

impl EventKind {
    /// Returns the severity of this event.
    #[must_use]
    pub fn severity(&self) -> EventSeverity {
        match self {
            EventKind::Command { fault: Some(_), .. } => EventSeverity::Error,
            EventKind::Command {
                reason: Some(reason),
                ..
            } if reason == "aborted" => EventSeverity::Warning,
            EventKind::Rule { state, .. } if state == "refused" => EventSeverity::Warning,
            EventKind::DriverState { state, .. } if state == "offline" => EventSeverity::Warning,
            EventKind::Quality { permille, was } if permille < was => EventSeverity::Warning,
            EventKind::CellStarted {
                previous: Some(_), ..
            }
            | EventKind::Started {
                predecessor: Some(_),
                ..
            } => EventSeverity::Warning,
            other => other.usual_severity(),
        }
    }

    /// Returns the device that the event concerns, if it names one. A driver's events concern the device that is its
    /// label.
    #[must_use]
    pub fn device(&self) -> Option<&str> {
        match self {
            EventKind::DeviceLost { device, .. }
            | EventKind::DeviceFound { device, .. }
            | EventKind::DeviceState { device, .. }
            | EventKind::DriverAttached { device, .. }
            | EventKind::DriverGone { device, .. } => Some(device),
            EventKind::BuildMismatch { process, .. }
            | EventKind::ConfigurationMismatch { process, .. } => process.strip_prefix("driver "),
            EventKind::Command {
                fault: Some(fault), ..
            } => fault.device.as_deref(),
            EventKind::FaultInjected {
                target: process, ..
            }
            | EventKind::ProcessStarted { process, .. }
            | EventKind::ProcessDied { process, .. }
            | EventKind::ProcessRestart { process, .. }
            | EventKind::ProcessFailed { process, .. }
            | EventKind::WatchdogKill { process, .. } => {
                Some(process.strip_prefix("driver/").unwrap_or(process))
            }
            _ => None,
        }
    }

    /// Returns the command that the event concerns.
    #[must_use]
    pub fn command(&self) -> Option<u64> {
        match self {
            EventKind::Command { command, .. }
            | EventKind::Loaded { command, .. }
            | EventKind::Rejected { command, .. } => Some(*command),
            EventKind::IncidentWritten { command, .. } | EventKind::Rule { command, .. } => {
                *command
            }
            _ => None,
        }
    }
}
