//! The kinds of events with their fields: one table, from which the type, the names and the documentation come.
//! Plain data.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::EventSeverity;

/// A kind of events, as in `docs/events.md`.
#[derive(Clone, Copy, Debug)]
pub struct EventKindRow {
    /// Its name in the log.
    pub name: &'static str,
    /// Who writes it.
    pub writer: &'static str,
    /// How much it matters, usually.
    pub severity: EventSeverity,
    /// What it says.
    pub summary: &'static str,
    /// Its fields.
    pub fields: &'static [&'static str],
}

macro_rules! kinds {
    ($(
        #[doc = $doc:literal]
        $name:ident = $text:literal, $writer:literal, $severity:ident {
            $($(#[doc = $about:literal])* $field:ident: $type:ty,)*
        }
    )*) => {
        /// What happened.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind", content = "fields")]
        pub enum EventKind {
            $(#[doc = $doc] #[serde(rename = $text)] $name { $($(#[doc = $about])* $field: $type,)* },)*
        }

        /// All kinds.
        pub const EVENT_KINDS: &[EventKindRow] = &[$(EventKindRow {
            name: $text,
            writer: $writer,
            severity: EventSeverity::$severity,
            summary: $doc,
            fields: &[$(stringify!($field)),*],
        }),*];

        impl EventKind {
            /// Its name in the log.
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
    /// A process of the cell is ready; if its predecessor died, which one that was.
    Started = "started", "every process", Info {
        /// For people; the executor's is its real-time grade.
        note: String,
        /// The dead process of the same role and label, if there was one.
        predecessor: Option<Predecessor>,
    }
    /// A process of the cell ends because it was asked to.
    Stopping = "stopping", "every process", Info {
        /// Who or what asked.
        why: String,
    }
    /// A helper thread of a process panicked or ended by itself: the process brings everything to rest and ends.
    HelperEnded = "helper-ended", "every process", Error {
        /// Which one, and how.
        why: String,
    }
    /// A helper thread of a process makes no progress: its heartbeat stops, so that its supervisor ends it.
    HelperHangs = "helper-hangs", "every process", Error {
        /// Its name.
        helper: String,
        /// How long it has made no turn, ms.
        silent_ms: u64,
        /// How long it may make none, ms.
        limit_ms: u64,
    }
    /// Whether another process lives could not be found out; nothing was done because of that, and it is tried again.
    LifeUnknown = "life-unknown", "every process", Warning {
        /// The process: executor, driver/lwr.
        process: String,
        /// What the system said.
        why: String,
    }
    /// Events were not written because there were too many at once, or because the log could not be written.
    Suppressed = "suppressed", "every process", Warning {
        /// How many.
        count: u64,
    }
    /// A command changed its state; a terminated one with its reason, a fault with its numbers.
    Command = "command", "executor", Info {
        /// Its id in this life of the executor.
        command: u64,
        /// loading, rejected, ready, running, canceling or terminated.
        state: String,
        /// finished, canceled, aborted or fault.
        reason: Option<String>,
        /// What was wrong.
        fault: Option<CommandFault>,
    }
    /// A device is lost: its ports are null from this cycle on.
    DeviceLost = "device-lost", "executor", Error {
        /// Its name.
        device: String,
        /// Age of the driver's last measurement, µs; nothing if it is young, and the driver itself says so.
        board_age_us: Option<u64>,
        /// The driver's life.
        driver: Option<String>,
        /// Why, if anybody knows.
        reason: String,
    }
    /// A device is there: its ports have values from this cycle on. No net commands it until START.
    DeviceFound = "device-found", "executor", Info {
        /// Its name.
        device: String,
        /// online, ready, commanded or stopping.
        state: String,
        /// The driver's life.
        driver: Option<String>,
    }
    /// A device changed its state as the executor sees it.
    DeviceState = "device-state", "executor", Info {
        /// Its name.
        device: String,
        /// The new state.
        state: String,
        /// The old one.
        was: String,
        /// The driver's words.
        reason: String,
    }
    /// The executor reads the boards of a new life of a driver.
    DriverAttached = "driver-attached", "executor", Info {
        /// Its device.
        device: String,
        /// The driver's process.
        pid: u32,
        /// The driver's life.
        driver: String,
    }
    /// The executor found a driver dead.
    DriverGone = "driver-gone", "executor", Warning {
        /// Its device.
        device: String,
        /// The driver's life.
        driver: String,
    }
    /// A process was built from another version than this one: they do not work together.
    BuildMismatch = "other-build", "executor, driver, loader", Error {
        /// The other one: `driver io`, `executor`.
        process: String,
        /// Its process id.
        pid: u32,
        /// Its life.
        life: String,
        /// Version and layout of both.
        differs: String,
        /// What to do.
        remedy: String,
    }
    /// A process was started with another configuration than this one: they do not work together.
    ConfigurationMismatch = "other-configuration", "executor, driver, loader", Error {
        /// The other one: `driver io`, `executor`.
        process: String,
        /// Its process id.
        pid: u32,
        /// Its life.
        life: String,
        /// In what the configurations differ, as far as that can be told.
        differs: String,
        /// What to do.
        remedy: String,
    }
    /// The files of the configuration say something else than what the cell was started with, or that again.
    ConfigurationChanged = "configuration-changed", "loader", Warning {
        /// What is not in force; empty: the files say again what is.
        differs: String,
        /// The first fault, if no process could be started with the files now.
        fault: Option<String>,
    }
    /// Cycles were late: at most one line a second.
    Late = "late", "executor", Warning {
        /// How many since the last line.
        count: u64,
        /// The first of them.
        first_cycle: u64,
        /// Longest time from a deadline to the wake-up, µs.
        worst_wake_us: f64,
        /// Longest evaluation, µs.
        worst_exec_us: f64,
        /// How many of them because they computed long; the others were woken late.
        computed_long: Option<u64>,
        /// The command that computed longest in one of these.
        command: Option<u64>,
        /// How long that was, µs.
        command_us: Option<f64>,
    }
    /// Somebody acknowledged late cycles: what is latched begins anew.
    Acknowledged = "acknowledged", "executor", Info {
        /// How many.
        late: u64,
    }
    /// The flight recorder wrote its last seconds to a file (`rcc-cli incidents`, `rcc-cli replay`).
    IncidentWritten = "incident-written", "executor", Warning {
        /// CommandFault, late or request.
        reason: String,
        /// The command that is the reason, if one is.
        command: Option<u64>,
        /// The file.
        file: String,
        /// What it holds, ms.
        span_ms: u64,
        /// Further faults in the same file.
        others: u64,
    }
    /// The flight recorder's last seconds could not be written; they are lost.
    IncidentLost = "incident-lost", "executor", Error {
        /// Why.
        why: String,
    }
    /// A text was compiled and its plan goes to the executor; this names the command.
    Loaded = "loaded", "loader", Info {
        /// The command.
        command: u64,
        /// The life of the executor that has it.
        executor: String,
        /// The net's name.
        net: String,
        /// Number of primitives.
        primitives: u32,
        /// What it uses.
        uses: Vec<String>,
    }
    /// A text was refused; the first fault.
    Rejected = "rejected", "loader", Warning {
        /// The command.
        command: u64,
        /// The life of the executor.
        executor: String,
        /// The net's name, if the text tells it.
        net: String,
        /// Code of the first fault.
        code: String,
        /// Its words.
        words: String,
        /// Number of faults.
        count: usize,
    }
    /// The loader works with this life of the executor.
    ExecutorFound = "executor-found", "loader", Info {
        /// Its process.
        pid: u32,
        /// Its life.
        executor: String,
    }
    /// The loader found the executor dead: all its commands are gone.
    ExecutorLost = "executor-lost", "loader", Error {
        /// Its process.
        pid: u32,
        /// Its life.
        executor: String,
    }
    /// A client was cut off.
    ClientCutOff = "client-cut-off", "loader", Warning {
        /// Which one, as far as one can tell.
        client: String,
        /// What it did.
        why: String,
    }
    /// A device changed its state as its driver sees it.
    DriverState = "driver-state", "driver", Info {
        /// The new state.
        state: String,
        /// The old one.
        was: String,
        /// Why it is not ready.
        reason: String,
    }
    /// The quality of the connection to a device has clearly changed.
    Quality = "quality", "driver", Info {
        /// Thousandths, 1000 is best.
        permille: u32,
        /// Before.
        was: u32,
    }
    /// A driver brings its device to rest by itself.
    RestBegun = "rest-begun", "driver", Warning {
        /// Why.
        reason: String,
    }
    /// A device that was brought to rest rests.
    RestReached = "rest-reached", "driver", Info {
        /// How long it took, ms.
        after_ms: u64,
    }
    /// A driver refused a set-point.
    Refused = "refused", "driver", Error {
        /// Joint from 1; 0: no joint, see the words.
        joint: u32,
        /// What was asked for.
        value: Option<f64>,
        /// What is allowed.
        limit: Option<f64>,
        /// Of both.
        unit: String,
        /// The broken rule in words.
        words: String,
    }
    /// Analog outputs were commanded out of their range and are released instead.
    OutOfRange = "out-of-range", "driver", Error {
        /// Their names.
        channels: Vec<String>,
    }
    /// A life of the cell begins.
    CellStarted = "cell-started", "supervisor", Info {
        /// The configuration.
        config: String,
        /// The ports of this life.
        ports: BTreeMap<String, u16>,
        /// The last event of a life that ended without a goodbye.
        previous: Option<LastEvent>,
    }
    /// The cell is being ended.
    CellStopping = "cell-stopping", "supervisor", Info {
        /// Who or what asked.
        why: String,
    }
    /// A process was started.
    ProcessStarted = "process-started", "supervisor", Info {
        /// Its name: executor, loader, driver/lwr, simulator/lwr-sim.
        process: String,
        /// Its process id.
        pid: u32,
    }
    /// A process died.
    ProcessDied = "process-died", "supervisor", Error {
        /// Its name.
        process: String,
        /// Its process id.
        pid: u32,
        /// Signal or exit code.
        how: String,
        /// The last line it wrote.
        last_words: String,
    }
    /// A process that died is started again.
    ProcessRestart = "process-restart", "supervisor", Warning {
        /// Its name.
        process: String,
        /// The how manieth time.
        nth: usize,
        /// How often it may be.
        most: usize,
        /// Within this time.
        within_s: u64,
    }
    /// A process is not started again.
    ProcessFailed = "process-failed", "supervisor", Error {
        /// Its name.
        process: String,
        /// Why not.
        why: String,
    }
    /// A process that gave no sign of life was killed.
    WatchdogKill = "watchdog-kill", "supervisor", Error {
        /// Its name.
        process: String,
        /// Its process id.
        pid: u32,
        /// How long it was silent, ms.
        silent_ms: u64,
    }
    /// What dead processes left was removed.
    Cleaned = "cleaned", "janitor", Info {
        /// Half-created files.
        half_created: usize,
        /// Dead nodes.
        dead_nodes: u64,
        /// Other files.
        files: usize,
        /// Whose, as far as announcements tell.
        of: Vec<String>,
    }
    /// Somebody broke something on purpose (`rcc-cli fault`).
    FaultInjected = "fault-injected", "cli", Warning {
        /// Device or process.
        target: String,
        /// What was done.
        what: String,
    }
}

/// A process that is dead.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Predecessor {
    /// Its process id.
    pub pid: u32,
    /// Its life, 16 hexadecimal digits.
    pub incarnation: String,
}

/// The last event of a life of the cell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastEvent {
    // Not the time first: only a line begins with it.
    /// Who.
    pub who: String,
    /// When.
    pub time: String,
    /// What.
    pub words: String,
}

/// Why a net was ended, with its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommandFault {
    /// device lost, jump, limit, panic, motion, overrun.
    pub code: String,
    /// The device.
    pub device: Option<String>,
    /// The joint, from 1.
    pub joint: Option<u32>,
    /// The rule that was broken.
    pub rule: Option<String>,
    /// What was asked for, SI.
    pub value: Option<f64>,
    /// What is allowed, SI.
    pub limit: Option<f64>,
    /// Unit of both.
    pub unit: Option<String>,
}

impl EventKind {
    /// How much it matters.
    #[must_use]
    pub fn severity(&self) -> EventSeverity {
        match self {
            EventKind::Command { fault: Some(_), .. } => EventSeverity::Error,
            EventKind::Command {
                reason: Some(reason),
                ..
            } if reason == "aborted" => EventSeverity::Warning,
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

    /// The device it is about, if it names one. A driver's events are about the device that is its label.
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

    /// The command it is about.
    #[must_use]
    pub fn command(&self) -> Option<u64> {
        match self {
            EventKind::Command { command, .. }
            | EventKind::Loaded { command, .. }
            | EventKind::Rejected { command, .. } => Some(*command),
            EventKind::IncidentWritten { command, .. } => *command,
            _ => None,
        }
    }
}
