//! The event log of a cell: one [`Event`] per line, in a file that can be read without any live process. Written by
//! threads that are not real-time (usually by the thread of an [`EventRecorder`]); read by any process.
//!
//! Several processes write the log. A line is at most [`LINE_MAX`](rcc_protocol::events::LINE_MAX) bytes and is written
//! by one `write` to a file opened with `O_APPEND`, so that lines of different processes never interleave (Linux holds
//! the inode lock for the whole call). A process that is killed within that call may leave a torn line, which readers
//! skip. A writer that finds the file full ([`FILE_MAX`]) renames it to `events.N.jsonl` under a lock, with N one more than
//! the last one's; the oldest beyond [`ROTATED_MAX`] is removed. Before each line a writer checks that its open file is
//! still the one at that path, so that no writer appends more than one line to a file that was renamed.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rcc_protocol::Role;
use rcc_protocol::events::{
    Event, EventKind, EventOrigin, EventSource, LastEvent, Predecessor, event_text, hex_digits,
};

use crate::cell::Cell;
use crate::clean::CleanReport;
use crate::lock;
use crate::state_folder::StateFolder;

mod reader;
mod recorder;

pub use reader::EventReader;
pub use recorder::EventRecorder;

/// Size at which the file is rotated, bytes.
pub const FILE_MAX: u64 = 1 << 20;
/// Maximum number of rotated files, whatever size the cell's configuration allows for the state folder: writers that do
/// not read it keep this bound.
pub const ROTATED_MAX: usize = 16;

impl Cell {
    /// Returns the path of the file with configuration and ports of the running cell, for programs that start later.
    #[must_use]
    pub fn running_file(&self) -> PathBuf {
        self.runtime_dir().join("cell.json")
    }
}

/// Appends an event. A failure cannot be reported anywhere, so callers usually ignore it.
///
/// # Errors
/// Returns an error if there is no state folder, if the disk is full, or if the event is too long.
pub fn append(cell: &Cell, event: &Event) -> io::Result<()> {
    append_to(&mut None, cell, event)
}

/// Like [`append`]; `kept` is the file from the previous call, reused as long as it is the one that readers find. A
/// caller that keeps it can write even when no file descriptor is free.
fn append_to(kept: &mut Option<File>, cell: &Cell, event: &Event) -> io::Result<()> {
    let line = event
        .line()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "the event is too long"))?;
    // Try once more if the file was rotated twice between opening and writing, since then no reader sees the line.
    let state = cell.state();
    let path = state.events_file();
    for _ in 0..2 {
        let mut file = match kept.take().filter(|file| is_at(file, &path)) {
            Some(file) => file,
            None => opened(&path)?,
        };
        file.write_all(&line)?;
        let found = file.metadata()?;
        if found.len() > FILE_MAX {
            rotate(&state, found.ino());
        }
        if found.nlink() > 0 {
            *kept = Some(file);
            break;
        }
    }
    Ok(())
}

/// Returns true if this open file is the one at `path`.
fn is_at(file: &File, path: &Path) -> bool {
    let numbers = |found: fs::Metadata| (found.dev(), found.ino());
    let (ours, there) = (
        file.metadata().map(numbers),
        fs::metadata(path).map(numbers),
    );
    matches!((ours, there), (Ok(ours), Ok(there)) if ours == there)
}

/// Appends an event of this process immediately.
pub fn tell(cell: &Cell, role: EventOrigin, label: &str, what: EventKind) {
    // A failure to write the log cannot be reported anywhere.
    let _ = append(
        cell,
        &Event::now(EventSource::this(role, label), None, what),
    );
}

/// Non-blocking, so that a named pipe at this path cannot block every process of the cell.
fn opened(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .append(true)
        .create(true)
        .mode(0o600)
        .custom_flags(nix::fcntl::OFlag::O_NONBLOCK.bits())
        .open(path)
}

/// Rotates the full file with this inode; a second caller finds another inode and does nothing.
fn rotate(state: &StateFolder, inode: u64) {
    let path = state.events_file();
    // Another process is rotating it.
    let Ok(_alone) = lock::exclusive(&state.events_lock_file()) else {
        return;
    };
    if fs::metadata(&path).is_ok_and(|found| found.ino() == inode) {
        let rotated = state.rotated_events();
        let number = rotated.last().map_or(1, |(last, _)| last.saturating_add(1));
        // A failure now is retried after the next line.
        let _ = fs::rename(&path, state.rotated_events_file(number));
        let many = (rotated.len() + 1).saturating_sub(ROTATED_MAX);
        for (_, oldest) in rotated.into_iter().take(many) {
            // It counts again at the next rotation.
            let _ = fs::remove_file(oldest);
        }
    }
}

/// Begins the log of a new run of the cell under `rcc-cli up`; if the previous one did not end in order, its last event
/// is reported in the first event.
pub fn begin_log(cell: &Cell, config: &str, ports: &BTreeMap<String, u16>) {
    let events = EventReader::open(&cell.state()).poll().unwrap_or_default();
    let previous = died(&events).map(|event| LastEvent {
        time: event.time.clone(),
        who: event.who(),
        words: event.sentence(&|_, id| format!("#{id}")),
    });
    let what = EventKind::CellStarted {
        config: config.to_owned(),
        ports: ports.clone(),
        previous,
    };
    tell(cell, EventOrigin::Supervisor, "up", what);
}

/// Returns the last event of the newest run under `rcc-cli up`, unless that run ended in order.
fn died(events: &[Event]) -> Option<&Event> {
    let start = |event: &Event| matches!(event.what, EventKind::CellStarted { .. });
    let run = &events[events.iter().rposition(start)?..];
    let ended = |event: &Event| matches!(event.what, EventKind::CellEnded { .. });
    run.last().filter(|_| !run.iter().any(ended))
}

/// Returns the dead process whose announcement is still there under this role and label, and which a newly announced
/// process therefore succeeds. An orderly end removes the announcement, so one that is left means a death.
#[must_use]
pub fn predecessor(cell: &Cell, role: Role, label: &str) -> Option<Predecessor> {
    let dead = cell.announced(role, label).ok().flatten()?;
    let ours = dead.pid == std::process::id();
    (!ours && dead.liveness().is_dead()).then(|| Predecessor {
        pid: dead.pid,
        incarnation: hex_digits(dead.incarnation),
    })
}

/// Records what a janitor removed, if anything, and which announced processes were dead at that time.
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

/// Returns the text for a reason number from the driver's announcement (lines of `NUMBER TEXT`), or `reason NUMBER` if
/// it has none; empty for 0.
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

#[cfg(test)]
mod tests;
