//! Reads the values of topics from the loader's stream, until their nets have ended or other topics are published. A thread
//! for every eight nets.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use rcc_client::published::PublishedTopic;
use rcc_client::{Cell, ClientError};

use super::{News, tell};
use rcc_process::readers::{EndRequest, Reader};

pub(super) struct ValueReader {
    pub cell: String,
    pub topics: Arc<Vec<PublishedTopic>>,
    pub rate_hz: f64,
    pub told: SyncSender<News>,
}

impl Reader for ValueReader {
    type Error = ClientError;

    fn read(&self, end: &EndRequest) -> Result<(), ClientError> {
        let cell = Cell::local(&self.cell)?;
        let ports: Vec<String> = self.topics.iter().map(PublishedTopic::path).collect();
        let ports: Vec<&str> = ports.iter().map(String::as_str).collect();
        for sample in cell.watch(&ports, self.rate_hz)? {
            let sample = sample?;
            if end.is_made() {
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
