//! Collects every monitor record of an executor while a test does something else.
//! A dedicated thread reads them, at a real-time priority if the system grants one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use rcc_core::message::MonitorRecord;
use rcc_ipc::Session;
use rcc_protocol::Role;
use rcc_protocol::control::RECORDS;

use crate::cell_fixture::CellFixture;
use crate::reference::promote;

/// Real-time priority of the collector: below the executor's, above all non-real-time threads.
const PRIORITY: i32 = 10;

/// The running collector.
#[derive(Debug)]
pub struct RecordCollector {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Vec<MonitorRecord>>,
}

impl RecordCollector {
    /// Starts collecting everything that the cell's running executor publishes from now on.
    pub fn follow(place: &CellFixture) -> RecordCollector {
        let executor = place.announced(Role::Executor, "exec");
        let cell = place.cell().clone();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let (told, tell) = std::sync::mpsc::channel();
        let thread = std::thread::spawn(move || {
            let session = Session::join(&cell, Role::Monitor, "records").expect("a cell");
            let mut stream = session
                .subscribe::<MonitorRecord>(&executor.services[RECORDS])
                .expect("the records' stream");
            // Without the priority it still collects, but may lose records on a busy machine.
            promote(None, PRIORITY);
            told.send(()).expect("the test waits");
            let mut all = Vec::new();
            loop {
                // Loaded before the last read, so that every record published before the end is read.
                let last = stopped.load(Ordering::Acquire);
                while stream.read_into(&mut all).expect("the stream can be read") {}
                if last {
                    return all;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        tell.recv().expect("the collector begins");
        RecordCollector { stop, thread }
    }

    /// Stops collecting and returns all records in order.
    pub fn finish(self) -> Vec<MonitorRecord> {
        self.stop.store(true, Ordering::Release);
        self.thread.join().expect("the collector does not panic")
    }
}
