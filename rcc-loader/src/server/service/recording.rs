//! Writes the last seconds of the flight recorder to a file. Run by blocking threads of the server.

use std::time::{Duration, Instant};

use rcc_api::bodies::WrittenIncident;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_protocol::control::{Answer, Call, RecordingState};
use rcc_protocol::events::hex_digits;

use super::{Service, unexpected};
use crate::server::caller::Caller;

/// Maximum time until a recording is in a file.
const RECORD_MAX: Duration = Duration::from_secs(8);
/// Interval at which the executor is asked whether it is.
const RECORD_POLL_EVERY: Duration = Duration::from_millis(50);

impl Service {
    /// Freezes the flight recorder, and waits until its last seconds are in a file.
    ///
    /// # Errors
    /// Returns an error if there is no executor, its recorder is off, or the file is not written in time.
    pub fn freeze(&self, caller: &Caller) -> Result<WrittenIncident, ApiError> {
        let (attached, _) = self.attach()?;
        let incarnation = attached.announcement.incarnation;
        let cycle = match self.executor.call_for(caller, &Call::Record)? {
            Answer::Done { cycle } => cycle,
            Answer::Refused(refusal) => {
                return Err(self.with_names(None, |names| names.refusal(0, refusal)));
            }
            _ => return Err(unexpected()),
        };
        let limit = Instant::now() + RECORD_MAX;
        // Polls, so that other requests to the executor do not wait meanwhile.
        loop {
            let (attached, _) = self.attach()?;
            if attached.announcement.incarnation != incarnation {
                return Err(recording_lost(
                    "the executor died before it wrote the file".to_owned(),
                ));
            }
            match self.executor.call(&Call::Recorded { cycle })? {
                Answer::Recorded(RecordingState::Written { file }) => {
                    return Ok(WrittenIncident {
                        cycle,
                        executor: hex_digits(incarnation),
                        file,
                    });
                }
                Answer::Recorded(RecordingState::Lost { why }) => return Err(recording_lost(why)),
                Answer::Recorded(RecordingState::NotYet) => {}
                _ => return Err(unexpected()),
            }
            if Instant::now() >= limit {
                return Err(ApiError::new(
                    codes::EXECUTOR_SILENT,
                    format!("the recording of cycle {cycle} was not written within {RECORD_MAX:?}"),
                    "the disk is slow: `rcc-cli events` reports when the file is written, `rcc-cli incidents` then lists it",
                ));
            }
            std::thread::sleep(RECORD_POLL_EVERY);
        }
    }
}

/// Returns the error for a recording that was not written.
fn recording_lost(why: String) -> ApiError {
    ApiError::new(
        codes::NOT_STORED,
        format!("the recording was not written: {why}"),
        "its data is lost; make sure that the folder of incidents is writable (`recorder: {folder: …}`)",
    )
}
