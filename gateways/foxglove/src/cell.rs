//! Reads the cell while somebody is connected, and follows it over restarts of its executor. A thread of its own, because
//! shared memory is polled. Without viewers this process takes no place in the cell, so that the cell may end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rcc_reading::messages::{CellMessages, MessageOptions};
use rcc_reading::selection::Selection;
use rcc_reading::source::CellSource;
use rcc_recording::file::RecordingError;

use crate::viewers::{LiveSink, Viewers};

/// Interval at which viewers and executors are looked for.
const IDLE: Duration = Duration::from_millis(50);
/// Interval at which the event log is read.
const EVENTS_EVERY: Duration = Duration::from_millis(200);
/// Pause after the cell could not be read.
const RETRY_AFTER: Duration = Duration::from_secs(2);
/// Time without viewers after which the cell is left.
const LINGER: Duration = Duration::from_secs(5);
/// Id of the status that says what is wrong with the cell.
const STATUS: &str = "cell";

/// Options of the thread that reads the cell.
#[derive(Clone, Debug)]
pub struct CellOptions {
    /// Name of the cell.
    pub cell: String,
    /// Greatest rate of a net or device, Hz.
    pub rate_hz: f64,
}

/// Reads and sends until `ends`.
pub fn run(options: &CellOptions, viewers: &Arc<Viewers>, ends: &AtomicBool) {
    let mut sink = LiveSink(Arc::clone(viewers));
    let view_every_ns = (1e9 / options.rate_hz) as u64;
    let mut messages = CellMessages::new(
        &mut sink,
        MessageOptions {
            selection: Selection::default(),
            view_every_ns,
            reader: "foxglove",
        },
    );
    // Acquire pairs with the release of the thread that ends the program.
    while !ends.load(Ordering::Acquire) {
        if viewers.is_viewed() {
            let followed = follow(options, &mut messages, &mut sink, ends);
            let ended = messages.end_nets(&mut sink);
            if let Err(error) = followed.and(ended) {
                tracing::error!(%error, "messages cannot be sent");
            }
        }
        std::thread::sleep(IDLE);
    }
}

/// Reads until nobody is connected any more.
fn follow(
    options: &CellOptions,
    messages: &mut CellMessages,
    sink: &mut LiveSink,
    ends: &AtomicBool,
) -> Result<(), RecordingError> {
    // Twice the rate that is sent; the record stream is read in each fifth poll, and its buffers hold 100 ms.
    let polls_hz = (2.0 * options.rate_hz).clamp(200.0, 2000.0);
    let pause = Duration::from_secs_f64(1.0 / polls_hz);
    let mut source = CellSource::new(&options.cell, polls_hz as u64);
    let (mut viewed, mut events) = (Instant::now(), Instant::now());
    while !ends.load(Ordering::Acquire) && viewed.elapsed() < LINGER {
        match source.poll() {
            Ok(batch) => messages.batch(sink, &batch)?,
            Err(error) => {
                let words = format!("cell `{}` cannot be read: {error}", options.cell);
                tracing::warn!("{words}");
                sink.0.set_status(STATUS, &words);
                std::thread::sleep(RETRY_AFTER);
                source = CellSource::new(&options.cell, polls_hz as u64);
                continue;
            }
        }
        if events.elapsed() >= EVENTS_EVERY {
            events = Instant::now();
            messages.write_events(sink)?;
            if sink.0.is_viewed() {
                viewed = Instant::now();
            }
        }
        if source.is_attached() {
            sink.0.remove_status(STATUS);
            std::thread::sleep(pause);
        } else {
            let words = format!("cell `{}` has no executor; waiting for one", options.cell);
            sink.0.set_status(STATUS, &words);
            std::thread::sleep(IDLE);
        }
    }
    Ok(())
}
