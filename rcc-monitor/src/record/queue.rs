//! The queue between the thread that reads the cell and the thread that writes the disk: a slow disk delays the second one
//! only. Bounded in bytes; what does not fit is dropped and counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

use rcc_core::message::{Measurement, MonitorRecord};

use rcc_reading::source::SourceBatch;

/// Greatest size of what waits, bytes: about half a minute of two arms and twenty monitors at 1 kHz.
pub const QUEUE_BYTES_MAX: u64 = 256 << 20;

/// The reading end's half.
pub struct BatchSender {
    sender: Sender<SourceBatch>,
    waiting: Arc<AtomicU64>,
    bytes_max: u64,
    /// Records and measurements that did not fit.
    pub dropped: u64,
}

/// The writing end's half.
pub struct BatchReceiver {
    receiver: Receiver<SourceBatch>,
    waiting: Arc<AtomicU64>,
}

/// Makes a queue of at most `bytes_max` bytes.
#[must_use]
pub fn queue(bytes_max: u64) -> (BatchSender, BatchReceiver) {
    let (sender, receiver) = mpsc::channel();
    let waiting = Arc::new(AtomicU64::new(0));
    let ours = BatchSender {
        sender,
        waiting: Arc::clone(&waiting),
        bytes_max,
        dropped: 0,
    };
    (ours, BatchReceiver { receiver, waiting })
}

fn size(batch: &SourceBatch) -> u64 {
    let records = batch.records.len() * size_of::<MonitorRecord>();
    let measured = batch.measurements.len() * size_of::<(usize, Option<Measurement>)>();
    (records + measured + size_of::<SourceBatch>() + 256) as u64
}

impl BatchSender {
    /// Passes a batch on; if there is no room, its records and measurements are dropped and counted as lost. Returns false
    /// if the writer has ended.
    pub fn send(&mut self, mut batch: SourceBatch) -> bool {
        // Relaxed: only a number; the queue itself orders the batches.
        if self.waiting.load(Ordering::Relaxed) + size(&batch) > self.bytes_max {
            let count = (batch.records.len() + batch.measurements.len()) as u64;
            self.dropped += count;
            batch.lost += count;
            batch.records.clear();
            batch.measurements.clear();
        }
        self.waiting.fetch_add(size(&batch), Ordering::Relaxed);
        self.sender.send(batch).is_ok()
    }
}

impl BatchReceiver {
    /// Waits for a batch; `Ok(None)` after the time, an error once the reader has ended.
    ///
    /// # Errors
    /// Fails if no more batches will come.
    pub fn receive(&self, timeout: Duration) -> Result<Option<SourceBatch>, RecvTimeoutError> {
        match self.receiver.recv_timeout(timeout) {
            Ok(batch) => {
                self.waiting.fetch_sub(size(&batch), Ordering::Relaxed);
                Ok(Some(batch))
            }
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_writer_that_does_not_come_after_costs_records_and_no_memory() {
        let (mut sender, receiver) = queue(20_000);
        let batch = || SourceBatch {
            records: vec![MonitorRecord::zeroed(); 20],
            ..SourceBatch::default()
        };
        for _ in 0..10 {
            assert!(sender.send(batch()));
        }
        assert!(sender.dropped > 0 && sender.dropped.is_multiple_of(20));
        let (mut records, mut lost) = (0, 0);
        while let Ok(Some(batch)) = receiver.receive(Duration::ZERO) {
            records += batch.records.len() as u64;
            lost += batch.lost;
        }
        assert_eq!((records + lost, lost), (200, sender.dropped));
        // There is room again.
        assert!(sender.send(batch()));
        let next = receiver.receive(Duration::ZERO).expect("the sender lives");
        assert_eq!(next.map(|batch| batch.records.len()), Some(20));
        drop(receiver);
        assert!(!sender.send(batch()), "the writer has ended");
    }
}
