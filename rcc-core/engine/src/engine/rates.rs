//! Nets that are not evaluated in every cycle: when they are due, what holds in between, and the effect of START and
//! ABORT. Real-time thread.
//!
//! A net is evaluated in the cycles with `cycle % every == phase`. In between its outputs stay as commanded, no monitor
//! is due, and a lost device ends it at once. START is answered in the first evaluation, CANCEL is seen by the next
//! evaluation, ABORT takes effect at once.

use rcc_core::message::{CommandState, EndReason, FaultRecord};
use rcc_core::plan::Rate;
use rcc_protocol::control::{Answer, Refusal};

use super::devices::merge;
use super::{Engine, PendingTransition};
use crate::queue::EngineReply;

impl Engine {
    pub(super) fn rate(&self, row: usize) -> Rate {
        let net = self.nets.get(row).and_then(Option::as_ref);
        net.map_or(Rate::EVERY_CYCLE, |net| net.rate())
    }

    /// Returns true if the net in `row` is evaluated in this cycle.
    pub(super) fn is_due(&self, row: usize) -> bool {
        self.rate(row).is_due(self.status.cycle)
    }

    /// A cycle in which the active net in `row` is not evaluated: its last outputs stay commanded.
    pub(super) fn between_cycles(&mut self, row: usize) {
        if let Some(fault) = self.device_loss_fault(row) {
            return self.end(row, EndReason::Fault, fault);
        }
        let Some(net) = self.nets.get(row).and_then(Option::as_ref) else {
            return;
        };
        // These contain no joints: nets that command joints are evaluated in every cycle.
        for (device, output) in self.devices.iter_mut().zip(net.outputs()) {
            merge(&mut device.output, output);
        }
    }

    /// A net that waits for its first cycle: refuses its START if the executor is stopping.
    pub(super) fn await_first_cycle(&mut self, row: usize, ticket: u64) {
        if self.stopping {
            self.pending[row] = PendingTransition::Nothing;
            let answer = Answer::Refused(Refusal::Stopping);
            self.send_reply(EngineReply::Answer { ticket, answer });
        }
    }

    /// Why a net that waited for its first cycle cannot start any more.
    pub(super) fn lost_while_waiting(&self, row: usize) -> Option<Refusal> {
        if self.rate(row).every <= 1 {
            return None;
        }
        self.check_devices(row, 0).err()
    }

    /// ABORT of a command whose START waits for the net's first cycle: it is never evaluated, and START is refused.
    /// Returns false if the command does not wait.
    pub(super) fn abort_before_first_cycle(&mut self, id: u64) -> bool {
        let mut rows = self.tables.commands.iter();
        let Some(row) = rows.position(|entry| entry.id == id && id != 0) else {
            return false;
        };
        let Some(&PendingTransition::Start { ticket }) = self.pending.get(row) else {
            return false;
        };
        let state = CommandState::Terminated as u32;
        let answer = Answer::Refused(Refusal::WrongState { state });
        self.send_reply(EngineReply::Answer { ticket, answer });
        self.end(row, EndReason::Aborted, FaultRecord::NONE);
        true
    }
}
