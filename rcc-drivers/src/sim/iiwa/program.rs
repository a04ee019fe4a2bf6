//! The program `iiwa-sim`: the simulated cabinet with sockets, a clock and threads.
//! Run by the main thread.

use super::cabinet::Cabinet;
use super::control::{CabinetRequest, ControlError};
use super::fault::AnswerRefusal;
use super::options::Options;
use super::statistics::Snapshot;
use crate::sim::network::Network;
use crate::sim::requests::{ControlAnswer, TraceRequest};
use crate::sim::robot_program::{self, Controller};
use crate::sim::trace::TraceRecord;

pub use crate::sim::robot_program::RunError;

impl Controller for Cabinet {
    type Request = CabinetRequest;
    type Refusal = ControlError;
    type State = Snapshot;
    type Datagram = Vec<u8>;
    type NotTaken = AnswerRefusal;

    fn period_s(&self) -> f64 {
        self.settings.period_s()
    }

    fn trace_request(request: &CabinetRequest) -> Option<TraceRequest> {
        match request {
            CabinetRequest::Trace(file) => Some(TraceRequest::of(file.clone())),
            CabinetRequest::Flush => Some(TraceRequest::Flush),
            _ => None,
        }
    }

    fn execute(
        &mut self,
        request: CabinetRequest,
    ) -> Result<ControlAnswer<Snapshot>, ControlError> {
        Cabinet::execute(self, request)
    }

    fn tick(&mut self, periods: u64) -> Option<Vec<u8>> {
        Cabinet::tick(self, periods)
    }

    fn receive(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), AnswerRefusal> {
        Cabinet::receive(self, bytes, delay_s)
    }

    fn receive_foreign(&mut self) {
        Cabinet::receive_foreign(self);
    }

    fn network(&mut self) -> &mut Network {
        &mut self.robot.network
    }

    fn exchanged(&self) -> Option<&TraceRecord> {
        Cabinet::exchanged(self)
    }

    fn is_closed(&self) -> bool {
        Cabinet::is_closed(self)
    }
}

/// Runs the simulator until SIGTERM, SIGINT, `quit` or, if requested, the end of its parent.
///
/// `ready` receives the line with the address that it sends from and that of its control port.
///
/// # Errors
/// Returns an error if an option is invalid, if the simulator could not start, or if a thread has died.
pub fn run(options: &Options, ready: impl FnOnce(&str)) -> Result<(), RunError> {
    let settings = options.settings();
    let settings = settings.map_err(|error| RunError::Option(error.into()))?;
    let common = options.robot.common("iiwa-sim");
    robot_program::run(Cabinet::new(settings), &common, ready)
}
