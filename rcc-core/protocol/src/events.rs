//! The events of a cell, as lines of its log: JSON objects that can be read without any live process. Plain data, and
//! the sentences that people read.

use rcc_os::clock::monotonic_ns;
use rcc_os::process_instance::ProcessInstance;
use serde::{Deserialize, Serialize};

use crate::role::Role;

mod kinds;
mod sentences;
mod wall_time;

pub use kinds::{CommandFault, EVENT_KINDS, EventKind, EventKindRow, LastEvent, Predecessor};
pub use sentences::CommandNames;
pub use wall_time::{since_epoch_of, wall_time, wall_time_before};

/// Maximum length of a line including the line feed, bytes; longer texts are truncated.
pub const LINE_MAX: usize = 4096;
/// Maximum length of a text field, bytes.
pub const TEXT_MAX: usize = 480;

/// Kind of process that writes an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventOrigin {
    /// Runs the cycle.
    Executor,
    /// Compiles nets to plans and serves the REST interface.
    Loader,
    /// Drives one device.
    Driver,
    /// Reads streams.
    Monitor,
    /// A command entered by a person.
    Cli,
    /// `rcc-cli up`.
    Supervisor,
    /// Cleans up after dead processes.
    Janitor,
}

impl From<Role> for EventOrigin {
    fn from(role: Role) -> EventOrigin {
        match role {
            Role::Loader => EventOrigin::Loader,
            Role::Executor => EventOrigin::Executor,
            Role::Driver => EventOrigin::Driver,
            Role::Monitor => EventOrigin::Monitor,
            Role::Cli => EventOrigin::Cli,
        }
    }
}

impl EventOrigin {
    /// Returns the name used in the log.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            EventOrigin::Executor => "executor",
            EventOrigin::Loader => "loader",
            EventOrigin::Driver => "driver",
            EventOrigin::Monitor => "monitor",
            EventOrigin::Cli => "cli",
            EventOrigin::Supervisor => "supervisor",
            EventOrigin::Janitor => "janitor",
        }
    }
}

/// Writer of an event.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EventSource {
    /// Kind of the process.
    pub role: EventOrigin,
    /// Distinguishes processes of one kind; for a driver, the name of its device.
    pub label: String,
    /// Process id.
    pub pid: u32,
    /// Incarnation of the process, 16 hexadecimal digits.
    pub incarnation: String,
}

impl EventSource {
    /// Returns the source for this process.
    #[must_use]
    pub fn this(role: EventOrigin, label: &str) -> EventSource {
        // `/proc` may be unreadable for a program outside a session: its events still carry the process id.
        let instance = ProcessInstance::current().unwrap_or(ProcessInstance {
            pid: std::process::id(),
            start_time_ticks: 0,
        });
        EventSource {
            role,
            label: label.to_owned(),
            pid: instance.pid,
            incarnation: hex_digits(instance.incarnation()),
        }
    }
}

/// Severity of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventSeverity {
    /// Normal operation.
    Info,
    /// Unexpected, but the cell copes.
    Warning,
    /// Something was lost, or ended because of it.
    Error,
}

/// One line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    // First field, because readers search for it to find the beginning of a line after a torn one.
    /// Wall time, `2026-11-21T16:02:03.123456Z`.
    pub time: String,
    /// CLOCK_MONOTONIC, ns.
    pub monotonic_ns: u64,
    /// Executor cycle, if the event belongs to one.
    pub cycle: Option<u64>,
    /// Writer of the event.
    pub source: EventSource,
    /// Severity.
    pub severity: EventSeverity,
    /// The event itself.
    #[serde(flatten)]
    pub what: EventKind,
}

impl Event {
    /// Creates an event with the current time.
    #[must_use]
    pub fn now(source: EventSource, cycle: Option<u64>, what: EventKind) -> Event {
        Event {
            time: wall_time(),
            monotonic_ns: monotonic_ns(),
            cycle,
            source,
            severity: what.severity(),
            what,
        }
    }

    /// Encodes the event as one line with its line feed, at most [`LINE_MAX`] bytes; `None` if that is not possible.
    #[must_use]
    pub fn line(&self) -> Option<Vec<u8>> {
        let mut line = serde_json::to_vec(self).ok()?;
        line.push(b'\n');
        (line.len() <= LINE_MAX).then_some(line)
    }
}

/// Formats an incarnation or a fingerprint as 16 hexadecimal digits: JSON numbers are not exact in that range.
#[must_use]
pub fn hex_digits(word: u64) -> String {
    format!("{word:016x}")
}

/// Makes a text fit into an event: truncated, one line, without control characters (readers print it on terminals).
#[must_use]
pub fn event_text(given: &str) -> String {
    let mut out = String::with_capacity(given.len().min(TEXT_MAX));
    for character in given.trim().chars() {
        if out.len() + character.len_utf8() > TEXT_MAX {
            out.push('…');
            break;
        }
        out.push(if character.is_control() {
            ' '
        } else {
            character
        });
    }
    out
}

#[cfg(test)]
mod tests;
