//! Nets with a lower rate than the cycle's: the cycles in which they are evaluated, their outputs in between, and the
//! effect of START and ABORT. Real-time thread.
//!
//! A net is evaluated in the cycles with `cycle % every == phase`. In between its outputs stay as commanded, no monitor
//! is due, and a lost device ends it at once. START is answered in the first evaluation, CANCEL is seen by the next
//! evaluation, ABORT takes effect at once.

use rcc_core::message::{CommandState, EndReason, FaultRecord};
use rcc_protocol::control::{Answer, Refusal};

use super::Engine;
use super::command_table::PendingTransition;
use super::handover::HandoverRows;
use crate::boards::DeviceBoards;
use crate::queue::EngineReply;
use crate::rows::RowIndex;

impl<B: DeviceBoards> Engine<B> {
    /// Returns true if the net in `row` is evaluated in this cycle.
    pub(super) fn is_due(&self, row: RowIndex) -> bool {
        self.commands[row].rate().is_due(self.status.cycle)
    }

    /// A cycle in which the active net in `row` is not evaluated: its last outputs stay commanded.
    pub(super) fn between_cycles(&mut self, row: RowIndex) {
        if let Some(fault) = self.device_loss_fault(row) {
            return self.end(row, EndReason::Fault, fault);
        }
        // These contain no joints: nets that command joints are evaluated in every cycle.
        self.merge_outputs(row);
    }

    /// A net that waits for its first cycle: refuses its START if the executor is stopping.
    pub(super) fn await_first_cycle(&mut self, row: RowIndex, ticket: u64) {
        if self.stopping {
            self.commands[row].pending = PendingTransition::Nothing;
            let answer = Answer::Refused(Refusal::Stopping);
            self.send_reply(EngineReply::Answer { ticket, answer });
        }
    }

    /// Why a net that waited for its first cycle cannot start any more.
    pub(super) fn lost_while_waiting(&self, row: RowIndex) -> Option<Refusal> {
        if self.commands[row].rate().every <= 1 {
            return None;
        }
        if self.stopping {
            return Some(Refusal::Stopping);
        }
        self.check_devices(row, HandoverRows::NONE).err()
    }

    /// CANCEL of a command whose START waits for the net's first cycle: it is never evaluated and stays ready, and START
    /// is refused. Returns false if the command does not wait.
    pub(super) fn withdraw_start(&mut self, id: u64) -> bool {
        self.refuse_start(id, Refusal::Withdrawn).is_some()
    }

    /// ABORT of a command whose START waits for the net's first cycle: it is never evaluated, and START is refused.
    /// Returns false if the command does not wait.
    pub(super) fn abort_before_first_cycle(&mut self, id: u64) -> bool {
        let state = CommandState::Terminated as u32;
        let Some(row) = self.refuse_start(id, Refusal::WrongState { state }) else {
            return false;
        };
        self.end(row, EndReason::Aborted, FaultRecord::NONE);
        true
    }

    /// Refuses a START that waits for the net's first cycle. Returns the row of the command if it does.
    fn refuse_start(&mut self, id: u64, refusal: Refusal) -> Option<RowIndex> {
        let row = self.commands.find(id, |_| true).ok()?;
        let PendingTransition::Start { ticket, .. } = self.commands[row].pending else {
            return None;
        };
        self.commands[row].pending = PendingTransition::Nothing;
        let answer = Answer::Refused(refusal);
        self.send_reply(EngineReply::Answer { ticket, answer });
        Some(row)
    }
}
