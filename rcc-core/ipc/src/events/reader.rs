//! Reads the event log from its oldest line and follows it as it grows, across rotations. Runs in any process; needs no
//! live writer.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rcc_protocol::events::{Event, LINE_MAX};

use crate::state_folder::StateFolder;

/// First bytes of every line; inside a JSON text the quotes would be escaped.
const BEGINNING: &[u8] = b"{\"time\":";
/// Maximum number of bytes taken from one file per call.
const LOOK_MAX: u64 = 4 << 20;

/// Reads the events that are kept of a cell.
#[derive(Debug)]
pub struct EventReader {
    folder: StateFolder,
    /// The newest rotated file: a writer may still append one line to it.
    old: Option<Tail>,
    current: Option<Tail>,
    /// Number of the newest rotated file that has been read.
    last_rotated: u64,
    unreadable: u64,
}

#[derive(Debug)]
struct Tail {
    file: File,
    inode: u64,
    rest: Vec<u8>,
}

impl EventReader {
    /// Opens a reader at the oldest line.
    #[must_use]
    pub fn open(folder: &StateFolder) -> EventReader {
        EventReader {
            folder: folder.clone(),
            old: None,
            current: None,
            last_rotated: 0,
            unreadable: 0,
        }
    }

    /// Opens a reader of the events from now on: the log may go back for months.
    #[must_use]
    pub fn open_at_end(folder: &StateFolder) -> EventReader {
        let mut current = Tail::open(&folder.events_file());
        if let Some(tail) = &mut current {
            // A file that cannot be sought is read from its beginning.
            let _ = tail.file.seek(SeekFrom::End(0));
        }
        // Listed after the file was opened, so that one that is rotated in between is not read again.
        let rotated = folder.rotated_events();
        EventReader {
            current,
            last_rotated: rotated.last().map_or(0, |(number, _)| *number),
            ..EventReader::open(folder)
        }
    }

    /// Returns the number of lines that are torn or not valid events.
    #[must_use]
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Returns the events since the last call, in the order of the files.
    ///
    /// # Errors
    /// Returns an error if a file cannot be read.
    pub fn poll(&mut self) -> io::Result<Vec<Event>> {
        let mut unreadable = 0;
        let tails = self.old.iter_mut().chain(&mut self.current);
        let mut events = read_in_order(tails.collect(), &mut unreadable)?;
        let known = self.current.as_ref().map(|tail| tail.inode);
        let inode = fs::metadata(self.folder.events_file());
        let inode = inode.ok().map(|found| found.ino());
        if known.is_none() || (inode.is_some() && inode != known) {
            self.take_new(&mut events, &mut unreadable)?;
        }
        self.unreadable += unreadable;
        Ok(events)
    }

    /// Switches to the new file at the path, and reads the files that were rotated since the last one.
    fn take_new(&mut self, events: &mut Vec<Event>, unreadable: &mut u64) -> io::Result<()> {
        let mut rotated: Vec<Tail> = self.current.take().into_iter().collect();
        // Opened before the rotated files are listed, so that none is missed that is rotated in between.
        self.current = Tail::open(&self.folder.events_file());
        let current = self.current.as_ref().map(|tail| tail.inode);
        for (number, path) in self.folder.rotated_events() {
            if number <= self.last_rotated {
                continue;
            }
            self.last_rotated = number;
            // It may have been removed just now.
            let Some(tail) = Tail::open(&path) else {
                continue;
            };
            let known = rotated.last().or(self.old.as_ref());
            let known = known.map(|tail| tail.inode);
            if ![known, current].contains(&Some(tail.inode)) {
                rotated.push(tail);
            }
        }
        let tails = rotated.iter_mut().chain(&mut self.current);
        let read = read_in_order(tails.collect(), unreadable);
        self.old = rotated.pop().or(self.old.take());
        events.extend(read?);
        Ok(())
    }
}

/// Returns the new lines of files in their order. The newest file is read first: a writer that appends to it has written
/// all its lines in the files before.
fn read_in_order(tails: Vec<&mut Tail>, unreadable: &mut u64) -> io::Result<Vec<Event>> {
    let mut parts = Vec::new();
    for tail in tails.into_iter().rev() {
        let mut part = Vec::new();
        tail.read(&mut part, unreadable)?;
        parts.push(part);
    }
    Ok(parts.into_iter().rev().flatten().collect())
}

impl Tail {
    fn open(path: &Path) -> Option<Tail> {
        let file = rcc_os::file::open(path).ok()?;
        let inode = file.metadata().ok()?.ino();
        Some(Tail {
            file,
            inode,
            rest: Vec::new(),
        })
    }

    fn read(&mut self, events: &mut Vec<Event>, unreadable: &mut u64) -> io::Result<()> {
        let mut bytes = std::mem::take(&mut self.rest);
        (&mut self.file).take(LOOK_MAX).read_to_end(&mut bytes)?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n');
        let (lines, rest) = bytes.split_at(whole.map_or(0, |at| at + 1));
        for line in lines.split(|byte| *byte == b'\n') {
            match parse(line) {
                Some(event) => events.push(event),
                None => *unreadable += u64::from(!line.is_empty()),
            }
        }
        // Keep only the end of the incomplete line: no valid line is longer.
        let kept = rest.len().saturating_sub(2 * LINE_MAX);
        self.rest = rest[kept..].to_vec();
        Ok(())
    }
}

/// Parses the event of a line. A torn line has no line feed, so the next event follows on the same line; it is found by
/// its first bytes.
fn parse(line: &[u8]) -> Option<Event> {
    let from = line
        .windows(BEGINNING.len())
        .rposition(|window| window == BEGINNING)?;
    let line = &line[from..];
    if line.len() > LINE_MAX {
        return None;
    }
    serde_json::from_slice(line).ok()
}
