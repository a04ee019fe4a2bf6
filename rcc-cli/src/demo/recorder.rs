//! Keeps all monitor records of the demo's cell in memory. A thread of its own reads the executor's stream; the demo's
//! main thread queries the records.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rcc_api::codes;
use rcc_core::message::MonitorRecord;
use rcc_ipc::{Cell, Session, Subscriber};
use rcc_protocol::Role;
use rcc_protocol::announcement::EXECUTOR_LABEL;
use rcc_protocol::control::RECORDS;

use crate::failure::Failure;

/// Polling interval of the stream; its buffers hold more than 100 ms.
const POLL_INTERVAL: Duration = Duration::from_millis(4);

#[derive(Default)]
struct RecordStore {
    /// Records by command.
    records: HashMap<u64, Vec<MonitorRecord>>,
    next_sequence: Option<u64>,
    lost: u64,
}

/// Keeps records until it is dropped.
pub struct MonitorRecorder {
    kept: Arc<Mutex<RecordStore>>,
    // Relaxed: the flag orders no other memory access.
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl MonitorRecorder {
    /// Starts to keep the records of the cell's executor.
    ///
    /// # Errors
    /// Fails if there is no executor or if its stream cannot be read.
    pub fn start(cell: &Cell) -> Result<MonitorRecorder, Failure> {
        let failed = |message: String| Failure::new(codes::NO_EXECUTOR, message, "");
        let announced = cell
            .announced(Role::Executor, EXECUTOR_LABEL)
            .map_err(|error| failed(error.to_string()))?;
        if let Some(executor) = &announced {
            rcc_protocol::Build::require_layout(executor)
                .map_err(|error| Failure::new(codes::OTHER_BUILD, error.to_string(), ""))?;
        }
        let service = announced
            .as_ref()
            .and_then(|announced| announced.services.get(RECORDS))
            .ok_or_else(|| failed(format!("cell `{}` has no record stream", cell.name())))?;
        let session =
            Session::join(cell, Role::Cli, "demo").map_err(|error| failed(error.to_string()))?;
        let subscriber = session
            .subscribe::<MonitorRecord>(service)
            .map_err(|error| failed(error.to_string()))?;
        let kept = Arc::new(Mutex::new(RecordStore::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let (kept_there, stop_there) = (Arc::clone(&kept), Arc::clone(&stop));
        let thread = thread::Builder::new()
            .name("recorder".into())
            .spawn(move || keep(session, subscriber, &kept_there, &stop_there))
            .map_err(|error| failed(error.to_string()))?;
        Ok(MonitorRecorder {
            kept,
            stop,
            thread: Some(thread),
        })
    }

    /// Returns the newest value of a monitor (its first element).
    #[must_use]
    pub fn newest(&self, command: u64, monitor: u32) -> Option<f64> {
        let kept = locked(&self.kept);
        let mut records = kept.records.get(&command)?.iter().rev();
        records
            .find(|record| record.monitor == monitor)
            .map(|record| record.values[0])
    }

    /// Returns the cycle of the newest record of a command; 0 without records.
    #[must_use]
    pub fn last_cycle(&self, command: u64) -> u64 {
        let kept = locked(&self.kept);
        let records = kept.records.get(&command);
        records
            .and_then(|all| all.last())
            .map_or(0, |last| last.cycle)
    }

    /// Removes and returns all records of a command, in order, with the number of records lost so far.
    #[must_use]
    pub fn take(&self, command: u64) -> (Vec<MonitorRecord>, u64) {
        let mut kept = locked(&self.kept);
        let records = kept.records.remove(&command).unwrap_or_default();
        (records, kept.lost)
    }
}

impl Drop for MonitorRecorder {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic was already printed by its thread, and nothing here depends on that thread any more.
            let _ = thread.join();
        }
    }
}

fn keep(
    session: Session,
    mut subscriber: Subscriber<MonitorRecord>,
    kept: &Mutex<RecordStore>,
    stop: &AtomicBool,
) {
    let mut batch = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        batch.clear();
        // The stream ends with the executor; missing records are detected by the checks.
        while matches!(subscriber.read_into(&mut batch), Ok(true)) {}
        let mut kept = locked(kept);
        for record in &batch {
            let expected = kept.next_sequence.unwrap_or(record.sequence);
            kept.lost += record.sequence.saturating_sub(expected);
            kept.next_sequence = Some(record.sequence + 1);
            kept.records
                .entry(record.command)
                .or_default()
                .push(*record);
        }
        drop(kept);
        thread::sleep(POLL_INTERVAL);
    }
    // Drop order: what was opened through the session is closed before the session.
    drop(subscriber);
    drop(session);
}

/// Ignores poisoning: records are added whole, so a panic leaves no partial record.
fn locked(kept: &Mutex<RecordStore>) -> MutexGuard<'_, RecordStore> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}
