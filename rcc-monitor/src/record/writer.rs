//! The thread that writes a recording. A slow disk delays only this thread; an error ends the recording and nothing else.

use std::time::{Duration, Instant};

use rcc_reading::messages::{CellMessages, MessageOptions, RecordLosses};
use rcc_recording::file::RecordingError;
use rcc_recording::recording::{Recording, RecordingSummary};
use rcc_recording::sink::RecordingState;

use super::queue::BatchReceiver;

/// Interval at which the file is made readable and the event log is read.
const FLUSH_EVERY: Duration = Duration::from_secs(1);
/// Longest wait for a batch.
const WAIT_MAX: Duration = Duration::from_millis(200);

/// How writing ended.
#[derive(Debug)]
pub struct WrittenRecording {
    /// Contents of the files.
    pub summary: RecordingSummary,
    /// Records that are missing.
    pub losses: RecordLosses,
    /// Patterns of ports for which no net had a monitor.
    pub unmatched: Vec<String>,
    /// The greatest size was reached.
    pub is_full: bool,
}

/// Writes until the reader ends or the recording is full.
///
/// # Errors
/// Fails if the file cannot be written; it ends at its last flush.
pub fn write(
    mut recording: Recording,
    options: MessageOptions,
    batches: &BatchReceiver,
) -> Result<WrittenRecording, RecordingError> {
    let mut messages = CellMessages::new(&mut recording, options);
    let mut flushed = Instant::now();
    while messages.state() == RecordingState::Open {
        match batches.receive(WAIT_MAX) {
            Ok(Some(batch)) => messages.batch(&mut recording, &batch)?,
            Ok(None) => {}
            Err(_) => break,
        }
        if flushed.elapsed() >= FLUSH_EVERY {
            flushed = Instant::now();
            messages.write_events(&mut recording)?;
            recording.flush()?;
        }
    }
    let is_full = messages.state() == RecordingState::Full;
    messages.end_nets(&mut recording)?;
    messages.write_events(&mut recording)?;
    Ok(WrittenRecording {
        losses: messages.losses(),
        unmatched: messages.unmatched(),
        summary: recording.finish()?,
        is_full,
    })
}
