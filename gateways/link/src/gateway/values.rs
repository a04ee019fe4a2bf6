//! Reads the values of topics from the loader's stream, until their nets have ended or other topics are published. A thread
//! for every eight nets.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::SyncSender;

use rcc_client::published::PublishedTopic;
use rcc_client::{Cell, ClientError};
use rcc_process::helpers;

use super::{News, tell};

pub(super) struct ValueReader {
    pub cell: String,
    pub topics: Arc<Vec<PublishedTopic>>,
    pub rate_hz: f64,
    pub told: SyncSender<News>,
    /// The present number, and that of this reader.
    pub generation: (Arc<AtomicU64>, u64),
}

impl ValueReader {
    pub fn start(self) -> io::Result<()> {
        helpers::thread("values", move || {
            if let Err(error) = self.read() {
                // The observer sees what has become of the nets.
                tracing::debug!(%error, "values end");
            }
        })
    }

    fn read(&self) -> Result<(), ClientError> {
        let cell = Cell::local(&self.cell)?;
        let ports: Vec<String> = self.topics.iter().map(PublishedTopic::path).collect();
        let ports: Vec<&str> = ports.iter().map(String::as_str).collect();
        let (present, own) = &self.generation;
        for sample in cell.watch(&ports, self.rate_hz)? {
            let sample = sample?;
            // Acquire pairs with the release of the observer.
            if present.load(Ordering::Acquire) != *own {
                return Ok(());
            }
            tell(
                &self.told,
                News::Values(Arc::clone(&self.topics), Box::new(sample)),
            );
        }
        Ok(())
    }
}
