//! `record`: writes what the monitors of a cell's nets see, every measurement of its devices, its events and its health to an
//! MCAP file. The main thread reads the cell, a second one writes the disk. It follows the cell over restarts.

use std::io;
use std::path::PathBuf;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rcc_core::counted::Counted;
use rcc_reading::messages::{MessageOptions, RecordLosses};
use rcc_reading::selection::Selection;
use rcc_reading::source::CellSource;
use rcc_reading::stream::StreamError;
use rcc_recording::file::RecordingError;
use rcc_recording::recording::{Recording, RecordingOptions, WhenFull};
use serde::Serialize;

use self::queue::{BatchSender, QUEUE_BYTES_MAX, queue};
use self::writer::WrittenRecording;
use crate::signals::Signals;
use crate::tail::print_note;

pub mod queue;
pub mod writer;

/// Interval at which the boards of the devices are read: twice in the period of a device at 1 kHz.
const POLL_EVERY: Duration = Duration::from_micros(500);
/// Polls per second.
const POLLS_HZ: u64 = 2000;
/// Interval at which an executor is looked for.
const FIND_EVERY: Duration = Duration::from_millis(50);

/// Selection of nets and ports, file, limits and duration of a recording.
#[derive(Clone, Debug)]
pub struct RecordOptions {
    /// The file.
    pub path: PathBuf,
    /// Nets and ports.
    pub selection: Selection,
    /// Greatest time.
    pub duration: Option<Duration>,
    /// Greatest size of all files together, bytes.
    pub bytes_max: u64,
    /// Behaviour at that size.
    pub when_full: WhenFull,
    /// Rate at which viewers get the arms, Hz.
    pub view_hz: f64,
}

/// The reason why a recording ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordEnd {
    /// The time is over.
    Time,
    /// A signal.
    Signal,
    /// The greatest size is reached.
    Size,
}

/// Result of a recording.
#[derive(Clone, Debug, Serialize)]
pub struct RecordReport {
    /// Why it ended.
    pub end: RecordEnd,
    /// The files that exist, the newest last.
    pub files: Vec<PathBuf>,
    /// Their size, bytes.
    pub bytes: u64,
    /// Messages written.
    pub messages: u64,
    /// Segments that were removed.
    pub removed: u64,
    /// Time from the first message that still exists to the last, s.
    pub span_s: f64,
    /// Patterns of `--ports` for which no net had a monitor.
    pub unmatched: Vec<String>,
    /// Counts of lost records.
    #[serde(flatten)]
    pub losses: RecordLosses,
}

/// The reason why nothing, or not everything, was recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The cell cannot be read.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// The file cannot be written.
    #[error("{0}; what was recorded before is in the file")]
    Write(RecordingError),
    /// The file, or a segment of an earlier recording, exists.
    #[error("{0}: name another file, or move that one away")]
    Exists(RecordingError),
    /// The file cannot be created.
    #[error(transparent)]
    Create(RecordingError),
    /// The thread that writes cannot be made.
    #[error("cannot make a thread: {0}")]
    Thread(io::Error),
    /// The thread that writes panicked.
    #[error("the thread that writes has panicked: report this as a bug")]
    Panic,
}

/// Records until the time is over, the greatest size is reached, or a signal arrives.
///
/// # Errors
/// Fails if a living executor cannot be read, or the file cannot be written.
pub fn record(
    cell: &str,
    options: &RecordOptions,
    signals: &mut Signals,
) -> Result<RecordReport, RecordError> {
    let recording = Recording::create(RecordingOptions {
        path: options.path.clone(),
        replace: false,
        bytes_max: options.bytes_max,
        when_full: options.when_full,
    });
    let recording = recording.map_err(|error| match error.source.kind() {
        io::ErrorKind::AlreadyExists => RecordError::Exists(error),
        _ => RecordError::Create(error),
    })?;
    let message_options = MessageOptions {
        selection: options.selection.clone(),
        view_every_ns: (1e9 / options.view_hz) as u64,
        reader: "recorder",
    };
    let (sender, receiver) = queue(QUEUE_BYTES_MAX);
    let writer = thread::Builder::new()
        .name("writer".to_owned())
        .spawn(move || writer::write(recording, message_options, &receiver))
        .map_err(RecordError::Thread)?;
    let read = read_cell(cell, options, signals, sender);
    let written = join(writer)?;
    let end = match (read?, written.is_full) {
        (_, true) => RecordEnd::Size,
        (end, false) => end,
    };
    Ok(report(end, &written))
}

fn join(
    writer: JoinHandle<Result<WrittenRecording, RecordingError>>,
) -> Result<WrittenRecording, RecordError> {
    let joined = writer.join().map_err(|_| RecordError::Panic)?;
    joined.map_err(RecordError::Write)
}

/// Reads the cell until something ends the recording. The queue is closed at the end, so that the writer ends too.
fn read_cell(
    cell: &str,
    options: &RecordOptions,
    signals: &mut Signals,
    mut sender: BatchSender,
) -> Result<RecordEnd, StreamError> {
    let mut source = CellSource::new(cell, POLLS_HZ);
    let started = Instant::now();
    let mut waiting_told = false;
    loop {
        if signals.pending().is_some() {
            return Ok(RecordEnd::Signal);
        }
        if options
            .duration
            .is_some_and(|limit| started.elapsed() >= limit)
        {
            return Ok(RecordEnd::Time);
        }
        let batch = source.poll()?;
        if batch.gone {
            print_note(&format!(
                "the executor of cell '{cell}' is gone; waiting for a new one"
            ));
        }
        if !batch.is_empty() && !sender.send(batch) {
            // The writer has ended, and says why.
            return Ok(RecordEnd::Size);
        }
        if source.is_attached() {
            thread::sleep(POLL_EVERY);
            continue;
        }
        if !waiting_told {
            waiting_told = true;
            print_note(&format!("cell '{cell}' has no executor; waiting for one"));
        }
        thread::sleep(FIND_EVERY);
    }
}

fn report(end: RecordEnd, written: &WrittenRecording) -> RecordReport {
    let summary = &written.summary;
    let [first_ns, last_ns] = summary.span_ns;
    RecordReport {
        end,
        files: summary.files.clone(),
        bytes: summary.bytes,
        messages: summary.messages,
        removed: summary.removed,
        span_s: last_ns.saturating_sub(first_ns) as f64 * 1e-9,
        unmatched: written.unmatched.clone(),
        losses: written.losses,
    }
}

impl RecordReport {
    /// Says in lines what was recorded, and what is missing.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let files: Vec<String> = self
            .files
            .iter()
            .map(|one| one.display().to_string())
            .collect();
        let mut lines = vec![format!(
            "recorded {:.1} s, {} in {} ({:.1} MB)",
            self.span_s,
            Counted(self.messages, "message"),
            files.join(", "),
            self.bytes as f64 * 1e-6
        )];
        if self.end == RecordEnd::Size {
            lines.push("ended at the greatest size: --max-size allows more".to_owned());
        }
        if self.removed > 0 {
            lines.push(format!(
                "removed the oldest: {}",
                Counted(self.removed, "segment")
            ));
        }
        for port in &self.unmatched {
            lines.push(format!(
                "no net had a monitor for `{port}`: only monitored ports are recorded, so add a Monitor to the net"
            ));
        }
        let losses = &self.losses;
        for (count, what) in [
            (losses.lost, "record of monitors lost"),
            (losses.missed, "measurement missed"),
            (
                losses.incomplete,
                "cycle left out because records of it are lost",
            ),
            (losses.rounded, "Int beyond ±2^53 rounded"),
        ] {
            if count > 0 {
                lines.push(format!("{count} × {what}"));
            }
        }
        lines
    }
}
