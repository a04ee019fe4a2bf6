//! Live values of ports, as an iterator that ends when no value can follow. Blocks the calling thread until the next
//! sample.

use rcc_api::streams::{StreamLoss, StreamValues};

use crate::error::ClientError;
use crate::transport::Lines;

/// Samples of ports as they arrive; dropping it ends the stream. The last item is an error if the loader ended the stream
/// before it was complete.
#[derive(Debug)]
pub struct Watch<'a> {
    lines: Lines<'a>,
    lost: u64,
    is_over: bool,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(lines: Lines<'a>) -> Watch<'a> {
        Watch {
            lines,
            lost: 0,
            is_over: false,
        }
    }

    /// Number of samples that were lost so far, because this program reads too slowly or the cell is busy.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns the next sample; `None` when no value can follow.
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
                    "end" => return Ok(None),
                    _ => {}
                }
            }
        }
        Err(ClientError::StreamEnded)
    }
}

impl Iterator for Watch<'_> {
    type Item = Result<StreamValues, ClientError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let sample = self.sample();
        self.is_over = !matches!(sample, Ok(Some(_)));
        sample.transpose()
    }
}
