//! Recorder of the events of one process: events are queued for a thread of their own, so that a slow disk delays no
//! caller, and rate-limited to what a person can read. The thread writes them in order and ends with the last handle.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rcc_protocol::Role;
use rcc_protocol::events::{Event, EventKind, EventOrigin, EventSource};

use crate::cell::Cell;

use super::{append_to, opened};

/// Maximum interval between two calls of `turn`, the thread's heartbeat.
const TURN_EVERY: Duration = Duration::from_millis(200);
/// How long the drop of the last handle waits for queued events.
const FAREWELL: Duration = Duration::from_secs(2);
/// Capacity of the queue.
const WAITING: usize = 256;
/// Burst size of the rate limit …
const BURST: f64 = 100.0;
/// … and its sustained rate, events per second; further events are only counted.
const PER_SECOND: f64 = 20.0;
/// Enough for formatting, and small because executors lock their memory.
const STACK: usize = 256 << 10;

/// Writes the events of one process; clones share one queue. Dropping the last one waits for the queue to drain.
#[derive(Clone, Debug)]
pub struct EventRecorder {
    source: EventSource,
    handle: Arc<QueueHandle>,
}

/// Item of the queue.
#[derive(Debug)]
enum QueueItem {
    /// An event to be written.
    Event(Box<Event>),
    /// Answered when everything queued before it has been written.
    Flush(SyncSender<()>),
}

#[derive(Debug)]
struct QueueHandle {
    queue: Option<SyncSender<QueueItem>>,
    // Relaxed everywhere: only a counter.
    lost: Arc<AtomicU64>,
    /// Disconnects when the thread ends.
    over: Mutex<Receiver<()>>,
}

impl EventRecorder {
    /// Starts the recorder of this process. Start it before the calling thread becomes real-time, because its thread
    /// inherits the scheduling.
    ///
    /// # Errors
    /// Returns an error if the system refuses a thread.
    pub fn start(cell: &Cell, role: Role, label: &str) -> io::Result<EventRecorder> {
        EventRecorder::watched(cell, role, label, || {})
    }

    /// Like [`EventRecorder::start`]; the thread calls `turn` several times per second, and drops it when it ends.
    ///
    /// # Errors
    /// Returns an error if the system refuses a thread.
    pub fn watched(
        cell: &Cell,
        role: Role,
        label: &str,
        turn: impl Fn() + Send + 'static,
    ) -> io::Result<EventRecorder> {
        let source = EventSource::this(EventOrigin::from(role), label);
        let (queue, events) = sync_channel(WAITING);
        let lost = Arc::new(AtomicU64::new(0));
        let writer = QueueWriter {
            cell: cell.clone(),
            source: source.clone(),
            lost: Arc::clone(&lost),
            tokens: BURST,
            filled: Instant::now(),
            // Open it now, while descriptors are free. If that fails, each line tries again.
            file: opened(&cell.state().events_file()).ok(),
        };
        let (alive, over) = sync_channel(0);
        let run = move || {
            writer.run(&events, &turn);
            drop(alive);
        };
        let thread = thread::Builder::new().name("events".into());
        let thread = thread.stack_size(STACK).spawn(run);
        thread.map_err(|error| {
            let words = format!(
                "cannot create the thread `events` ({error}): raise TasksMax= or pids.max of its group, or the limit \
                 nproc of its user"
            );
            io::Error::new(error.kind(), words)
        })?;
        Ok(EventRecorder {
            source,
            handle: Arc::new(QueueHandle {
                queue: Some(queue),
                lost,
                over: Mutex::new(over),
            }),
        })
    }

    /// Records an event with the current time; never waits.
    pub fn tell(&self, what: EventKind) {
        self.tell_in(None, what);
    }

    /// Records an event of an executor cycle; never waits.
    pub fn tell_in(&self, cycle: Option<u64>, what: EventKind) {
        self.record(Event::now(self.source.clone(), cycle, what));
    }

    /// Returns the source of the events.
    #[must_use]
    pub fn source(&self) -> &EventSource {
        &self.source
    }

    /// Records an event that was created earlier; never waits.
    pub fn record(&self, event: Event) {
        if let Some(queue) = &self.handle.queue
            && queue.try_send(QueueItem::Event(Box::new(event))).is_err()
        {
            self.handle.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl EventRecorder {
    /// Waits until all events queued so far are written, at most `patience`. For the end of a process whose other
    /// threads keep a handle.
    pub fn flush(&self, patience: Duration) {
        let (done, written) = sync_channel(1);
        if let Some(queue) = &self.handle.queue
            && queue.try_send(QueueItem::Flush(done)).is_ok()
        {
            // Timed out: the disk is slow, and the end of the process does not wait for it.
            let _ = written.recv_timeout(patience);
        }
    }
}

impl Drop for QueueHandle {
    fn drop(&mut self) {
        self.queue = None;
        let over = self.over.get_mut().unwrap_or_else(PoisonError::into_inner);
        // Timed out: the disk is slow or hangs, and the end of the process does not wait for it.
        let _ = over.recv_timeout(FAREWELL);
    }
}

struct QueueWriter {
    cell: Cell,
    source: EventSource,
    lost: Arc<AtomicU64>,
    tokens: f64,
    filled: Instant,
    file: Option<File>,
}

impl QueueWriter {
    fn run(mut self, messages: &Receiver<QueueItem>, turn: &impl Fn()) {
        loop {
            turn();
            match messages.recv_timeout(TURN_EVERY) {
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
                Ok(QueueItem::Event(event)) => self.write(&event),
                Ok(QueueItem::Flush(done)) => {
                    self.tell_lost();
                    // The requester may have stopped waiting.
                    let _ = done.send(());
                }
            }
        }
        self.tell_lost();
    }

    fn write(&mut self, event: &Event) {
        let now = Instant::now();
        let gained = now.duration_since(self.filled).as_secs_f64() * PER_SECOND;
        self.tokens = (self.tokens + gained).min(BURST);
        self.filled = now;
        if self.tokens < 1.0 {
            self.lost.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.tokens -= 1.0;
        self.tell_lost();
        self.append(event, 1);
    }

    fn tell_lost(&mut self) {
        let count = self.lost.swap(0, Ordering::Relaxed);
        if count > 0 {
            let what = EventKind::Suppressed { count };
            let event = Event::now(self.source.clone(), None, what);
            self.append(&event, count);
        }
    }

    /// Appends a line. If that fails, counts the events that the line stands for, so that a later line reports them.
    fn append(&mut self, event: &Event, stands_for: u64) {
        if append_to(&mut self.file, &self.cell, event).is_err() {
            self.lost.fetch_add(stands_for, Ordering::Relaxed);
        }
    }
}
