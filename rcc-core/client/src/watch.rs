//! Live values of ports, as an iterator. Blocks the calling thread until the next sample.

use rcc_api::streams::{StreamLoss, StreamValues};

use crate::error::ClientError;
use crate::transport::Lines;

/// Samples of ports as they arrive; dropping it ends the stream.
#[derive(Debug)]
pub struct Watch<'a> {
    lines: Lines<'a>,
    lost: u64,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(lines: Lines<'a>) -> Watch<'a> {
        Watch { lines, lost: 0 }
    }

    /// Number of samples that were lost so far, because this program reads too slowly or the cell is busy.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns the next sample; `None` when the loader ends the stream.
    fn sample(&mut self) -> Result<Option<StreamValues>, ClientError> {
        let understood = |error: serde_json::Error| ClientError::NotUnderstood(error.to_string());
        let mut event = String::new();
        while let Some(line) = self.lines.next_line()? {
            if let Some(name) = line.strip_prefix("event: ") {
                name.clone_into(&mut event);
            } else if let Some(data) = line.strip_prefix("data: ") {
                match event.as_str() {
                    "values" => return serde_json::from_str(data).map_err(understood),
                    "lost" => {
                        let lost: StreamLoss = serde_json::from_str(data).map_err(understood)?;
                        self.lost += lost.samples;
                    }
                    _ => {}
                }
            }
        }
        Ok(None)
    }
}

impl Iterator for Watch<'_> {
    type Item = Result<StreamValues, ClientError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.sample().transpose()
    }
}
