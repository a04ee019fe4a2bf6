//! The program `lwr-sim`: the simulated KRC with sockets, a clock and threads.
//! Run by the main thread.

use super::control::{ControlError, KrcCommand};
use super::fault::DatagramRefusal;
use super::krc::Krc;
use super::options::Options;
use super::statistics::Snapshot;
use crate::fri_lwr::wire::MSR_SIZE;
use crate::sim::network::Network;
use crate::sim::requests::{ControlAnswer, TraceRequest};
use crate::sim::robot_program::{self, Controller};
use crate::sim::trace::TraceRecord;

pub use crate::sim::robot_program::RunError;

impl Controller for Krc {
    type Request = KrcCommand;
    type Refusal = ControlError;
    type State = Snapshot;
    type Datagram = [u8; MSR_SIZE];
    type NotTaken = DatagramRefusal;

    fn period_s(&self) -> f64 {
        self.settings.period_s
    }

    fn trace_request(request: &KrcCommand) -> Option<TraceRequest> {
        match request {
            KrcCommand::Trace(file) => Some(TraceRequest::of(file.clone())),
            KrcCommand::Flush => Some(TraceRequest::Flush),
            _ => None,
        }
    }

    fn execute(&mut self, request: KrcCommand) -> Result<ControlAnswer<Snapshot>, ControlError> {
        Krc::execute(self, request)
    }

    fn tick(&mut self, periods: u64) -> Option<[u8; MSR_SIZE]> {
        Krc::tick(self, periods)
    }

    fn receive(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), DatagramRefusal> {
        Krc::receive(self, bytes, delay_s)
    }

    fn receive_foreign(&mut self) {
        Krc::receive_foreign(self);
    }

    fn network(&mut self) -> &mut Network {
        &mut self.robot.network
    }

    fn exchanged(&self) -> Option<&TraceRecord> {
        Krc::exchanged(self)
    }

    fn is_closed(&self) -> bool {
        Krc::is_closed(self)
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
    let common = options.robot.common("lwr-sim");
    robot_program::run(Krc::new(settings), &common, ready)
}
