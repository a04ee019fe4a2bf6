//! The life cycle of commands (figure 2 of the paper): requests, evaluation of rows, and termination. Real-time thread.

use bytemuck::Zeroable;
use rcc_core::message::{
    COMMANDS_MAX, CommandEntry, CommandState, DeviceState, EndReason, FaultCode, FaultRecord,
};
use rcc_protocol::control::{Answer, InputValue, Refusal};

use super::{Engine, PendingTransition, SETTLE_MAX_NS, is_active};
use crate::net::{Evaluation, Net, monitor_record};
use crate::queue::{EngineEvent, EngineReply, EngineRequest, ValueReading};
use crate::record::{EvaluationRecord, TriggerReason};

impl Engine {
    pub(super) fn execute(&mut self, request: EngineRequest) {
        if let Some(recorder) = &mut self.recorder {
            recorder.request(&request);
        }
        let (ticket, result) = match request {
            EngineRequest::Reserve { ticket } => (ticket, self.reserve().map(Some)),
            EngineRequest::Install { ticket, id, net } => {
                (ticket, self.install(id, net).map(|()| None))
            }
            EngineRequest::Renew { id, net } => return self.renew(id, net),
            EngineRequest::Reject { ticket, id } => (ticket, self.reject(id).map(|()| None)),
            EngineRequest::Start { ticket, id } => match self.accept_start(ticket, id) {
                // Answered after the first evaluation.
                Ok(()) => return,
                Err(refusal) => (ticket, Err(refusal)),
            },
            // Answered after it was tried.
            EngineRequest::Handover {
                ticket,
                stop,
                start,
            } => return self.take_handover(ticket, stop, start),
            EngineRequest::Cancel { ticket, id } => (ticket, self.cancel(id).map(|()| None)),
            EngineRequest::Abort { ticket, id } => (ticket, self.abort(id).map(|()| None)),
            EngineRequest::Unload { ticket, id } => (ticket, self.unload(id).map(|()| None)),
            EngineRequest::Read {
                ticket,
                id,
                mut reading,
            } => {
                let refused = self.read(id, &mut reading).err();
                return self.send_reply(EngineReply::Read {
                    ticket,
                    reading,
                    refused,
                });
            }
            EngineRequest::Set { ticket, id, values } => {
                (ticket, self.set(id, values).map(|()| None))
            }
            EngineRequest::Record { ticket } => (ticket, self.freeze().map(|()| None)),
            EngineRequest::Acknowledge { ticket } => {
                self.acknowledge();
                (ticket, Ok(None))
            }
            EngineRequest::Attach {
                device,
                incarnation,
                board,
            } => return self.attach(device, incarnation, board),
            EngineRequest::Detach {
                device,
                incarnation,
            } => return self.detach(device, incarnation),
        };
        let cycle = self.status.cycle;
        let answer = match result {
            Ok(Some(id)) => Answer::Reserved { id },
            Ok(None) => Answer::Done { cycle },
            Err(refusal) => Answer::Refused(refusal),
        };
        self.send_reply(EngineReply::Answer { ticket, answer });
    }

    /// Freezes the recording on request.
    fn freeze(&mut self) -> Result<(), Refusal> {
        let recorder = self.recorder.as_mut().ok_or(Refusal::NoRecorder)?;
        recorder.trigger(TriggerReason::Request);
        Ok(())
    }

    fn reserve(&mut self) -> Result<u64, Refusal> {
        let row = self
            .tables
            .commands
            .iter()
            .position(|entry| entry.id == 0)
            .ok_or(Refusal::TableFull)?;
        let id = self.next_id;
        self.next_id += 1;
        if let Some(entry) = self.tables.commands.get_mut(row) {
            *entry = CommandEntry {
                id,
                fault: FaultRecord::NONE,
                ..CommandEntry::zeroed()
            };
        }
        self.set_state(row, CommandState::Loading);
        Ok(id)
    }

    fn install(&mut self, id: u64, net: Box<Net>) -> Result<(), Refusal> {
        let row = self.row_in(id, |state| state == CommandState::Loading);
        let place =
            row.and_then(|row| Ok((row, self.nets.get_mut(row).ok_or(Refusal::UnknownCommand)?)));
        match place {
            Ok((row, place)) => {
                let (can_cancel, expected_ns) = (net.can_cancel(), net.expected_ns);
                self.subscribers |= u64::from(net.subscribes()) << row;
                *place = Some(net);
                if let Some(entry) = self.tables.commands.get_mut(row) {
                    entry.can_cancel = u64::from(can_cancel);
                    entry.expected_ns = expected_ns;
                }
                self.set_state(row, CommandState::Ready);
                Ok(())
            }
            Err(refusal) => {
                self.send_reply(EngineReply::Net(net));
                Err(refusal)
            }
        }
    }

    fn renew(&mut self, id: u64, mut net: Box<Net>) {
        let row = self.row_in(id, |state| state == CommandState::Ready).ok();
        let row = row.filter(|row| self.pending.get(*row) == Some(&PendingTransition::Nothing));
        if let Some(Some(old)) = row.and_then(|row| self.nets.get_mut(row)) {
            std::mem::swap(net.inputs_mut(), old.inputs_mut());
            std::mem::swap(&mut net, old);
        }
        self.send_reply(EngineReply::Net(net));
    }

    fn reject(&mut self, id: u64) -> Result<(), Refusal> {
        let row = self.row_in(id, |state| state == CommandState::Loading)?;
        self.set_state(row, CommandState::Rejected);
        Ok(())
    }

    fn accept_start(&mut self, ticket: u64, id: u64) -> Result<(), Refusal> {
        let row = self.row_in(id, |state| state == CommandState::Ready)?;
        if self.stopping {
            return Err(Refusal::Stopping);
        }
        if self.pending.get(row) != Some(&PendingTransition::Nothing) {
            return Err(Refusal::WrongState {
                state: CommandState::Ready as u32,
            });
        }
        self.check_free(row, 0, 0)?;
        self.check_topics(row, 0, 0)?;
        self.check_devices(row, 0)?;
        self.check_budget(row, 0, 0)?;
        self.pending[row] = PendingTransition::Start { ticket };
        self.busy |= 1 << row;
        Ok(())
    }

    /// Checks that no other active command holds a resource that this one claims, except for those that leave (bit r:
    /// row r). Commands that arrive in the same hand-over count as holding theirs.
    pub(super) fn check_free(&self, row: usize, leave: u64, arrive: u64) -> Result<(), Refusal> {
        let Some(claims) = self.claims(row) else {
            return Err(Refusal::UnknownCommand);
        };
        for (other, holder) in self.other_active(row, leave, arrive) {
            if let Some(resource) = self.claims(other).and_then(|held| claims.common(held)) {
                return Err(Refusal::Busy { holder, resource });
            }
        }
        Ok(())
    }

    /// Rows and ids of the other active commands, without those that leave, and with those that arrive.
    pub(super) fn other_active(
        &self,
        row: usize,
        leave: u64,
        arrive: u64,
    ) -> impl Iterator<Item = (usize, u64)> + '_ {
        let others = self.tables.commands.iter().enumerate();
        let others = others.filter(move |(other, entry)| {
            let active = is_active(entry.state)
                || self.pending.get(*other) != Some(&PendingTransition::Nothing);
            let counts = active && leave >> other & 1 == 0 || arrive >> other & 1 == 1;
            *other != row && counts
        });
        others.map(|(other, entry)| (other, entry.id))
    }

    /// Checks that each arm is ready, or is handed over by a command that leaves (bit r: row r), and that no other
    /// device is offline.
    pub(super) fn check_devices(&self, row: usize, leave: u64) -> Result<(), Refusal> {
        let Some(claims) = self.claims(row) else {
            return Err(Refusal::UnknownCommand);
        };
        for (index, input) in self.inputs.iter().enumerate() {
            let state = self.device_state(index);
            let arm = claims.arms >> index & 1 == 1;
            let ready = if arm {
                state == DeviceState::Ready
                    || state == DeviceState::Commanded && self.leaves_arm(index, leave)
            } else {
                state != DeviceState::Offline
            };
            if claims.uses(index) && !ready {
                let reason = input.measurement.reason;
                return Err(Refusal::DeviceNotReady {
                    device: index as u32,
                    state: state as u32,
                    reason,
                });
            }
        }
        Ok(())
    }

    fn cancel(&mut self, id: u64) -> Result<(), Refusal> {
        let row = self.row_in(id, |state| state == CommandState::Running)?;
        match self.nets.get_mut(row).and_then(Option::as_mut) {
            Some(net) if net.can_cancel() => net.cancel_requested = true,
            _ => return Err(Refusal::NotCancelable),
        }
        self.set_state(row, CommandState::Canceling);
        Ok(())
    }

    fn abort(&mut self, id: u64) -> Result<(), Refusal> {
        if self.abort_before_first_cycle(id) {
            return Ok(());
        }
        let row = self.row_in(id, CommandState::is_active)?;
        self.end(row, EndReason::Aborted, FaultRecord::NONE);
        Ok(())
    }

    /// Reads values as the last evaluation left them.
    fn read(&self, id: u64, reading: &mut ValueReading) -> Result<(), Refusal> {
        let row = self.row_in(id, |_| true)?;
        let state = self.tables.commands.get(row).map_or(0, |entry| entry.state);
        let Some(Some(net)) = self.nets.get(row) else {
            return Err(Refusal::WrongState { state });
        };
        net.read(reading)?;
        reading.values.state = state;
        Ok(())
    }

    /// Stages values for the next evaluation of the net.
    fn set(&mut self, id: u64, values: Vec<InputValue>) -> Result<(), Refusal> {
        let allowed = |state: CommandState| state == CommandState::Ready || state.is_active();
        let row = self.row_in(id, allowed);
        let set = row.and_then(|row| match self.nets.get_mut(row) {
            Some(Some(net)) => net.set(&values),
            _ => Err(Refusal::UnknownCommand),
        });
        self.send_reply(EngineReply::Values(values));
        set
    }

    fn unload(&mut self, id: u64) -> Result<(), Refusal> {
        let row = self.row_in(id, |state| !state.is_active())?;
        if self.pending.get(row) != Some(&PendingTransition::Nothing) {
            return Err(Refusal::WrongState {
                state: CommandState::Running as u32,
            });
        }
        self.subscribers &= !(1 << row);
        if let Some(net) = self.nets.get_mut(row).and_then(Option::take) {
            self.send_reply(EngineReply::Net(net));
        }
        if let Some(entry) = self.tables.commands.get_mut(row) {
            *entry = CommandEntry::zeroed();
        }
        self.tables_changed = true;
        Ok(())
    }

    /// Cancels every net that can be cancelled, and aborts the others.
    pub(super) fn cancel_all(&mut self) {
        for row in 0..COMMANDS_MAX {
            let Some(entry) = self.tables.commands.get(row) else {
                continue;
            };
            let (id, state) = (entry.id, CommandState::from_number(entry.state));
            if state == CommandState::Running && self.cancel(id).is_err() {
                self.end(row, EndReason::Aborted, FaultRecord::NONE);
            }
        }
    }

    /// Aborts all active commands.
    pub fn abort_all(&mut self) {
        for row in 0..COMMANDS_MAX {
            if self
                .tables
                .commands
                .get(row)
                .is_some_and(|entry| is_active(entry.state))
            {
                self.end(row, EndReason::Aborted, FaultRecord::NONE);
            }
        }
    }

    /// One cycle of one row of the command table.
    pub(super) fn run_row(&mut self, row: usize, now_ns: u64) {
        let (Some(entry), Some(&pending)) = (self.tables.commands.get(row), self.pending.get(row))
        else {
            return;
        };
        let active = is_active(entry.state);
        match pending {
            PendingTransition::Settle { since_cycle } => self.settle(row, since_cycle),
            PendingTransition::Start { ticket } if self.is_due(row) => {
                self.first_cycle(row, ticket, now_ns)
            }
            PendingTransition::Start { ticket } => self.await_first_cycle(row, ticket),
            PendingTransition::Nothing if active && self.is_due(row) => {
                self.next_cycle(row, now_ns)
            }
            PendingTransition::Nothing if active => self.between_cycles(row),
            PendingTransition::Nothing => {}
        }
    }

    fn survives_device_loss(&self, row: usize) -> bool {
        let net = self.nets.get(row).and_then(Option::as_ref);
        net.is_some_and(|net| net.survives_device_loss())
    }

    /// The fault of the net in `row` if a device that it uses is lost and it does not handle device loss.
    pub(super) fn device_loss_fault(&self, row: usize) -> Option<FaultRecord> {
        let lost = self.lost_device(row)?;
        (!self.survives_device_loss(row)).then(|| FaultRecord {
            device: lost as u32,
            ..self.fault(FaultCode::DeviceLost)
        })
    }

    fn next_cycle(&mut self, row: usize, now_ns: u64) {
        let survives = self.survives_device_loss(row);
        if let Some(fault) = self.device_loss_fault(row) {
            return self.end(row, EndReason::Fault, fault);
        }
        match self.evaluate(row) {
            Evaluation::Fault(code) => self.end(row, EndReason::Fault, self.fault(code)),
            evaluation => match self.pass_commands(row) {
                Err(fault) if survives && fault.code == FaultCode::DeviceLost as u32 => {
                    self.disengage(row)
                }
                Err(fault) => self.end(row, EndReason::Fault, fault),
                Ok(()) => {
                    self.push_monitors(row, now_ns);
                    if evaluation == Evaluation::Terminated {
                        self.terminate(row);
                    }
                }
            },
        }
    }

    /// The first evaluation decides about START: its set-points must begin at the hold set-points of the arms. If they
    /// do not, nothing of this cycle is written and the command stays ready.
    fn first_cycle(&mut self, row: usize, ticket: u64, now_ns: u64) {
        self.pending[row] = PendingTransition::Nothing;
        if let Some(refusal) = self.lost_while_waiting(row) {
            self.reset_to_ready(row);
            let answer = Answer::Refused(refusal);
            return self.send_reply(EngineReply::Answer { ticket, answer });
        }
        let cycle = self.status.cycle;
        let refusal = match self.evaluate(row) {
            Evaluation::Fault(code) => {
                self.set_state(row, CommandState::Running);
                self.end(row, EndReason::Fault, self.fault(code));
                Some(Refusal::FirstCycle { code: code as u32 })
            }
            evaluation => match self.pass_commands(row) {
                Ok(()) => {
                    self.commit_start(row, evaluation, now_ns);
                    None
                }
                Err(fault) => {
                    self.disengage(row);
                    self.reset_to_ready(row);
                    Some(self.refusal_of(fault))
                }
            },
        };
        let answer = refusal.map_or(Answer::Done { cycle }, Answer::Refused);
        self.send_reply(EngineReply::Answer { ticket, answer });
    }

    /// Commits the first cycle of a row: the command is running.
    pub(super) fn commit_start(&mut self, row: usize, evaluation: Evaluation, now_ns: u64) {
        if let Some(entry) = self.tables.commands.get_mut(row) {
            entry.started_cycle = self.status.cycle;
        }
        self.set_state(row, CommandState::Running);
        self.publish(row);
        self.push_monitors(row, now_ns);
        if evaluation == Evaluation::Terminated {
            self.terminate(row);
        }
    }

    /// Restores the state of a ready row whose first evaluation was not accepted.
    pub(super) fn reset_to_ready(&mut self, row: usize) {
        if let Some(net) = self.nets.get_mut(row).and_then(Option::as_mut) {
            net.reset_after_refused_start();
        }
        if let Some(entry) = self.tables.commands.get_mut(row) {
            (entry.cycles, entry.exec_sum_ns) = (0, 0);
            (entry.exec_last_ns, entry.exec_max_ns) = (0, 0);
        }
    }

    pub(super) fn refusal_of(&self, fault: FaultRecord) -> Refusal {
        if fault.code == FaultCode::DeviceLost as u32 {
            let index = fault.device as usize;
            let state = self.device_state(index) as u32;
            let reason = self
                .inputs
                .get(index)
                .map_or(0, |input| input.measurement.reason);
            return Refusal::DeviceNotReady {
                device: fault.device,
                state,
                reason,
            };
        }
        Refusal::FirstSetPoint {
            device: fault.device,
            joint: fault.joint,
            value: fault.value,
            limit: fault.limit,
            violation: fault.violation,
        }
    }

    pub(super) fn evaluate(&mut self, row: usize) -> Evaluation {
        let Some(net) = self.nets.get_mut(row).and_then(Option::as_mut) else {
            return Evaluation::Fault(FaultCode::Panic);
        };
        let (begins, cancel) = (net.cycles == 0, net.cancel_requested);
        if let (Some(recorder), Some(entry)) = (&mut self.recorder, self.tables.commands.get(row)) {
            for (input, words, late) in net.inputs().staged_values() {
                recorder.set(entry.id, input, words, late);
            }
        }
        let (models, inputs) = (&self.config.models, &self.inputs);
        let (evaluation, exec_ns) = self.time.evaluate(row, net, models, inputs, self.dt_s);
        net.evaluated_cycle = self.status.cycle;
        if let Some(entry) = self.tables.commands.get_mut(row) {
            entry.cycles = net.cycles;
            entry.exec_last_ns = exec_ns;
            entry.exec_max_ns = entry.exec_max_ns.max(exec_ns);
            entry.exec_sum_ns += exec_ns;
            self.time.record_duration(entry.id, exec_ns);
            if let Some(recorder) = &mut self.recorder {
                recorder.net(EvaluationRecord {
                    row,
                    id: entry.id,
                    net,
                    evaluation,
                    begins,
                    cancel,
                    dt_s: self.dt_s,
                });
            }
        }
        evaluation
    }

    /// Sends the monitors that are due to the pump thread.
    fn push_monitors(&mut self, row: usize, now_ns: u64) {
        let (Some(Some(net)), Some(entry)) = (self.nets.get(row), self.tables.commands.get(row))
        else {
            return;
        };
        let (cycle, id) = (self.status.cycle, entry.id);
        let (records, next, dropped) = (
            &mut self.rings.records,
            &mut self.next_record,
            &mut self.status.dropped_records,
        );
        net.monitors(|monitor, values| {
            let mut record = monitor_record(cycle, now_ns, id, monitor, values);
            record.sequence = *next;
            *next += 1;
            if records.push(record).is_err() {
                *dropped += 1;
            }
        });
    }

    /// The net has terminated: its arms play their last set-points, then the command is terminated.
    fn terminate(&mut self, row: usize) {
        let since_cycle = self.status.cycle;
        if let Some(entry) = self.tables.commands.get_mut(row) {
            entry.ended_cycle = since_cycle;
        }
        let commands_arms = self.claims(row).is_some_and(|claims| claims.arms != 0);
        if commands_arms {
            self.pending[row] = PendingTransition::Settle { since_cycle };
            self.unpublish(row);
        } else {
            self.finish(row);
        }
    }

    fn settle(&mut self, row: usize, since_cycle: u64) {
        let period_ns = self.config.period_ns;
        self.disengage(row);
        let waited_ns = (self.status.cycle - since_cycle) * period_ns;
        // The driver receives the first image without a position in the cycle after the last evaluation.
        if self.arms_settled(row, (since_cycle + 1) * period_ns) {
            return self.finish(row);
        }
        let lost = self.lost_device(row).map(|device| device as u32);
        if lost.is_some() || waited_ns > SETTLE_MAX_NS {
            let arm = || {
                self.claims(row)
                    .map_or(u32::MAX, |claims| claims.arms.trailing_zeros())
            };
            let device = lost.unwrap_or_else(arm);
            let fault = FaultRecord {
                device,
                ..self.fault(FaultCode::DeviceLost)
            };
            self.end(row, EndReason::Fault, fault);
        }
    }

    pub(super) fn finish(&mut self, row: usize) {
        let canceled = self
            .nets
            .get(row)
            .and_then(Option::as_ref)
            .is_some_and(|net| net.cancel_requested);
        let reason = if canceled {
            EndReason::Canceled
        } else {
            EndReason::Finished
        };
        self.end(row, reason, FaultRecord::NONE);
    }

    /// Terminates a row in any state. Outputs that were passed on in this cycle stay written; from the next cycle on
    /// nothing is commanded.
    pub(super) fn end(&mut self, row: usize, reason: EndReason, fault: FaultRecord) {
        self.pending[row] = PendingTransition::Nothing;
        self.subscribers &= !(1 << row);
        self.unpublish(row);
        self.disengage(row);
        let cycle = self.status.cycle;
        if let Some(entry) = self.tables.commands.get_mut(row) {
            entry.reason = reason as u32;
            entry.fault = fault;
            if entry.ended_cycle == 0 {
                entry.ended_cycle = cycle;
            }
        }
        self.set_state(row, CommandState::Terminated);
    }

    fn set_state(&mut self, row: usize, state: CommandState) {
        let cycle = self.status.cycle;
        let Some(entry) = self.tables.commands.get_mut(row) else {
            return;
        };
        entry.state = state as u32;
        if state.is_active() {
            self.busy |= 1 << row;
        }
        let event = EngineEvent::Command {
            cycle,
            id: entry.id,
            state: state as u32,
            reason: entry.reason,
            fault: entry.fault,
        };
        if let Some(recorder) = &mut self.recorder {
            recorder.state(entry.id, entry.state, entry.reason, &entry.fault);
        }
        self.tables_changed = true;
        self.log(event);
    }

    /// The row of a command that must be in an allowed state.
    pub(super) fn row_in(
        &self,
        id: u64,
        allowed: impl Fn(CommandState) -> bool,
    ) -> Result<usize, Refusal> {
        let rows = self.tables.commands.iter().enumerate();
        let (row, entry) = rows
            .filter(|_| id != 0)
            .find(|(_, entry)| entry.id == id)
            .ok_or(Refusal::UnknownCommand)?;
        let state = CommandState::from_number(entry.state);
        if allowed(state) {
            Ok(row)
        } else {
            Err(Refusal::WrongState { state: entry.state })
        }
    }
}
