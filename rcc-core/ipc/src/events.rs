//! The cell's event log: what happened in the cell, one JSON object a line, in a file that needs no living process.
//! Written by threads that are not real-time (mostly by a [`EventRecorder`]'s own), read by anybody.
//!
//! Several writers: a line is at most [`LINE_MAX`] bytes and written by one `write` to a file opened with `O_APPEND`,
//! so that lines of different processes never mix (Linux holds the file's lock for the whole call). A process that is
//! killed within that call may leave a torn line, which readers skip. Who finds the file full ([`FILE_MAX`]) moves it
//! to `events.1.jsonl` under a lock; before each line a writer looks whether the file that it has open is still the one at
//! that name, so that nobody writes to a moved one for longer than one line.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::cell::Cell;
use crate::clean::CleanReport;
use crate::clock::monotonic_ns;
use crate::lock;
use crate::process_instance::ProcessInstance;
use crate::session::Role;

mod kinds;
mod reader;
mod recorder;
mod sentences;
mod wall_time;

pub use kinds::{CommandFault, EVENT_KINDS, EventKind, EventKindRow, LastEvent, Predecessor};
pub use reader::EventReader;
pub use recorder::EventRecorder;
pub use wall_time::{wall_time, wall_time_before};

/// Longest line, with its end; longer texts are cut.
pub const LINE_MAX: usize = 4096;
/// A file that is longer is moved aside; two of this size exist at most.
pub const FILE_MAX: u64 = 1 << 20;
/// Longest text of a field, in bytes.
const TEXT_MAX: usize = 480;

/// What a process is that writes events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventOrigin {
    /// The cycle.
    Executor,
    /// Text to plans; the REST server.
    Loader,
    /// One device.
    Driver,
    /// Reads streams.
    Monitor,
    /// A command that a person typed.
    Cli,
    /// `rcc-cli up`.
    Supervisor,
    /// Cleans up after the dead.
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
    /// As in the log.
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

/// Who writes an event.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EventSource {
    /// What it does in the cell.
    pub role: EventOrigin,
    /// Which one of its role; a driver's is its device's name.
    pub label: String,
    /// Its process id.
    pub pid: u32,
    /// Its life, 16 hexadecimal digits.
    pub incarnation: String,
}

impl EventSource {
    /// This process, in this role.
    #[must_use]
    pub fn this(role: EventOrigin, label: &str) -> EventSource {
        // Unknown only to a program that is in no session: its events still have its process id.
        let life = ProcessInstance::current().unwrap_or(ProcessInstance {
            pid: std::process::id(),
            start_time_ticks: 0,
        });
        EventSource {
            role,
            label: label.to_owned(),
            pid: life.pid,
            incarnation: hex_digits(life.incarnation()),
        }
    }
}

/// How much an event matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventSeverity {
    /// In order.
    Info,
    /// Not in order; the cell copes.
    Warning,
    /// Something was lost or ended because of it.
    Error,
}

/// One line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    // First, because readers find the beginning of a line after a torn one by it.
    /// Wall time, `2026-11-21T16:02:03.123456Z`.
    pub time: String,
    /// CLOCK_MONOTONIC, ns.
    pub monotonic_ns: u64,
    /// Executor cycle, where there is one.
    pub cycle: Option<u64>,
    /// Who says so.
    pub source: EventSource,
    /// How much it matters.
    pub severity: EventSeverity,
    /// What happened.
    #[serde(flatten)]
    pub what: EventKind,
}

impl Event {
    /// What happens now.
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

    /// As one line with its end, never longer than [`LINE_MAX`]; nothing for an event that cannot be written.
    fn line(&self) -> Option<Vec<u8>> {
        let mut line = serde_json::to_vec(self).ok()?;
        line.push(b'\n');
        (line.len() <= LINE_MAX).then_some(line)
    }
}

impl Cell {
    /// The newest events.
    #[must_use]
    pub fn events_file(&self) -> PathBuf {
        self.runtime_dir().join("events.jsonl")
    }

    /// The events before those.
    #[must_use]
    pub fn events_before_file(&self) -> PathBuf {
        self.runtime_dir().join("events.1.jsonl")
    }

    fn events_lock_file(&self) -> PathBuf {
        self.runtime_dir().join("events.lock")
    }

    /// Configuration and ports of the running cell, for programs that come later.
    #[must_use]
    pub fn running_file(&self) -> PathBuf {
        self.runtime_dir().join("cell.json")
    }

    /// What belongs to one life of the cell and goes with its orderly end, whether it is there or not.
    pub(crate) fn life_files(&self) -> [PathBuf; 4] {
        [
            self.events_file(),
            self.events_before_file(),
            self.events_lock_file(),
            self.running_file(),
        ]
    }
}

/// Appends an event. Nobody can be told when that fails, so callers usually ignore it.
///
/// # Errors
/// The folder is gone (the cell has ended), the disk is full, or the event is too long.
pub fn append(cell: &Cell, event: &Event) -> io::Result<()> {
    append_to(&mut None, cell, event)
}

/// As [`append`]; `kept` is the file of the last time, used as long as it is the one that readers find. Who keeps it can
/// write when no descriptor is free.
fn append_to(kept: &mut Option<File>, cell: &Cell, event: &Event) -> io::Result<()> {
    let line = event
        .line()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "the event is too long"))?;
    // Once more if the file was moved aside twice between opening and writing, and with it the line out of sight.
    for _ in 0..2 {
        let mut file = match kept.take().filter(|file| is_at(file, &cell.events_file())) {
            Some(file) => file,
            None => opened(&cell.events_file())?,
        };
        file.write_all(&line)?;
        let found = file.metadata()?;
        if found.len() > FILE_MAX {
            rotate(cell, found.ino());
        }
        if found.nlink() > 0 {
            *kept = Some(file);
            break;
        }
    }
    Ok(())
}

/// True if this open file lies at `path`.
fn is_at(file: &File, path: &Path) -> bool {
    let numbers = |found: fs::Metadata| (found.dev(), found.ino());
    let (ours, there) = (
        file.metadata().map(numbers),
        fs::metadata(path).map(numbers),
    );
    matches!((ours, there), (Ok(ours), Ok(there)) if ours == there)
}

/// Appends an event of this process, written at once.
pub fn tell(cell: &Cell, role: EventOrigin, label: &str, what: EventKind) {
    // A log that cannot be written has nobody to be told to.
    let _ = append(
        cell,
        &Event::now(EventSource::this(role, label), None, what),
    );
}

/// A pipe in its place would be waited for, by every process of the cell.
fn opened(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .append(true)
        .create(true)
        .mode(0o600)
        .custom_flags(nix::fcntl::OFlag::O_NONBLOCK.bits())
        .open(path)
}

/// Moves the full file with this inode aside; who comes second finds another one.
fn rotate(cell: &Cell, inode: u64) {
    let path = cell.events_file();
    // Somebody else is at it: they will do it.
    let Ok(_alone) = lock::exclusive(&cell.events_lock_file()) else {
        return;
    };
    if fs::metadata(&path).is_ok_and(|found| found.ino() == inode) {
        // What fails now is tried again after the next line.
        let _ = fs::rename(&path, cell.events_before_file());
    }
}

/// A new life of the cell begins: what the life before it wrote becomes the old file, and is told in the first event.
pub fn begin_log(cell: &Cell, config: &str, ports: &BTreeMap<String, u16>) {
    let path = cell.events_file();
    let mut previous = None;
    if path.exists() {
        // An orderly end removes the log: whoever finds one follows a cell that died.
        let last = EventReader::open(cell).poll().unwrap_or_default().pop();
        previous = last.map(|event| LastEvent {
            time: event.time.clone(),
            who: event.who(),
            words: event.sentence(&|_, id| format!("#{id}")),
        });
        let _ = fs::rename(&path, cell.events_before_file());
    }
    let what = EventKind::CellStarted {
        config: config.to_owned(),
        ports: ports.clone(),
        previous,
    };
    tell(cell, EventOrigin::Supervisor, "up", what);
}

/// The dead process that left its announcement under this role and label: whoever announces itself there follows it.
/// An orderly end takes the announcement back, so it tells of a death.
#[must_use]
pub fn predecessor(cell: &Cell, role: Role, label: &str) -> Option<Predecessor> {
    let dead = cell.announced(role, label).ok().flatten()?;
    let ours = dead.pid == std::process::id();
    (!ours && dead.liveness().is_dead()).then(|| Predecessor {
        pid: dead.pid,
        incarnation: hex_digits(dead.incarnation),
    })
}

/// Tells what a janitor removed, if anything, and who was dead then.
pub fn log_cleaning(cell: &Cell, report: &CleanReport) {
    if *report == CleanReport::default() {
        return;
    }
    let announced = cell.announced_all().unwrap_or_default();
    let dead = announced.iter().filter(|one| one.liveness().is_dead());
    let what = EventKind::Cleaned {
        half_created: report.half_created,
        dead_nodes: report.dead_nodes,
        files: report.reaped,
        of: dead
            .map(|one| format!("{} {} (pid {})", one.role, one.label, one.pid))
            .take(8)
            .collect(),
    };
    tell(cell, EventOrigin::Janitor, "janitor", what);
}

/// What a driver's announcement says about this number: lines of `NUMBER TEXT`. Empty when it says nothing.
#[must_use]
pub fn reason_words(cell: &Cell, device: &str, number: u32) -> String {
    if number == 0 {
        return String::new();
    }
    let announced = cell.announced(Role::Driver, device).ok().flatten();
    let note = announced.map(|one| one.note).unwrap_or_default();
    let wanted = number.to_string();
    let found = note
        .lines()
        .filter_map(|line| line.split_once(' '))
        .find(|(number, _)| *number == wanted);
    found.map_or_else(
        || format!("reason {number}"),
        |(_, words)| event_text(words),
    )
}

/// A life or a fingerprint as 16 hexadecimal digits: JSON numbers are not exact so far.
#[must_use]
pub fn hex_digits(word: u64) -> String {
    format!("{word:016x}")
}

/// A text that fits into an event: short, one line, no control characters (readers print it on terminals).
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
