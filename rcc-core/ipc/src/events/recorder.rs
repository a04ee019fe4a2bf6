//! One process' handle: events are handed to a thread of its own, so that a slow disk holds nobody up, and no more of
//! them than a person can read. The thread writes them in order and ends with the last handle.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::cell::Cell;
use crate::session::Role;

use super::{Event, EventKind, EventOrigin, EventSource, append_to, opened};

/// The thread shows that it lives at least so often.
const TURN_EVERY: Duration = Duration::from_millis(200);
/// How long the last handle waits for what is still to be written.
const FAREWELL: Duration = Duration::from_secs(2);
/// Events that may wait for the thread.
const WAITING: usize = 256;
/// So many events at once …
const BURST: f64 = 100.0;
/// … and then so many a second; the others are only counted.
const PER_SECOND: f64 = 20.0;
/// Enough for formatting; executors lock their memory.
const STACK: usize = 256 << 10;

/// Writes the events of one process; clones write to the same queue. Dropping the last one waits for the queue.
#[derive(Clone, Debug)]
pub struct EventRecorder {
    source: EventSource,
    handle: Arc<QueueHandle>,
}

/// What the thread is given.
#[derive(Debug)]
enum QueueItem {
    /// To be written.
    Event(Box<Event>),
    /// To be answered when everything before it is written.
    Flush(SyncSender<()>),
}

#[derive(Debug)]
struct QueueHandle {
    queue: Option<SyncSender<QueueItem>>,
    // Relaxed everywhere: a number that is only counted.
    lost: Arc<AtomicU64>,
    /// Hangs up when the thread ends.
    over: Mutex<Receiver<()>>,
}

impl EventRecorder {
    /// The recorder of this process. Start it before the calling thread becomes real-time: its thread inherits.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn start(cell: &Cell, role: Role, label: &str) -> io::Result<EventRecorder> {
        EventRecorder::watched(cell, role, label, || {})
    }

    /// As [`EventRecorder::start`]; the thread calls `turn` several times a second, and drops it when it ends.
    ///
    /// # Errors
    /// The system refuses a thread.
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
            // Now, while there are descriptors. If it cannot be opened, each line tries again.
            file: opened(&cell.events_file()).ok(),
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
                "the system gives no thread `events` ({error}): raise TasksMax= or pids.max of its group, or the limit \
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

    /// Records what happens now; never waits.
    pub fn tell(&self, what: EventKind) {
        self.tell_in(None, what);
    }

    /// Records what happened in a cycle of the executor; never waits.
    pub fn tell_in(&self, cycle: Option<u64>, what: EventKind) {
        self.record(Event::now(self.source.clone(), cycle, what));
    }

    /// Who writes.
    #[must_use]
    pub fn source(&self) -> &EventSource {
        &self.source
    }

    /// Records an event that was made before; never waits.
    pub fn record(&self, event: Event) {
        if let Some(queue) = &self.handle.queue
            && queue.try_send(QueueItem::Event(Box::new(event))).is_err()
        {
            self.handle.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl EventRecorder {
    /// Waits until everything told so far is written, at most this long; for the end of a process whose other threads
    /// keep a handle.
    pub fn flush(&self, patience: Duration) {
        let (done, written) = sync_channel(1);
        if let Some(queue) = &self.handle.queue
            && queue.try_send(QueueItem::Flush(done)).is_ok()
        {
            // Late: the disk is slow, and the end of the process does not wait for it.
            let _ = written.recv_timeout(patience);
        }
    }
}

impl Drop for QueueHandle {
    fn drop(&mut self) {
        self.queue = None;
        let over = self.over.get_mut().unwrap_or_else(PoisonError::into_inner);
        // Late: the disk is slow or hangs, and the end of the process does not wait for it.
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
                    // Who asked waits no more.
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

    /// A line that cannot be written is counted, with what it stands for: the next one that can be tells of it.
    fn append(&mut self, event: &Event, stands_for: u64) {
        if append_to(&mut self.file, &self.cell, event).is_err() {
            self.lost.fetch_add(stands_for, Ordering::Relaxed);
        }
    }
}
