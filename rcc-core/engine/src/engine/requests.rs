//! Requests to the engine: each is carried out between two cycles, or refused without a change. Real-time thread.

use bytemuck::Zeroable;
use rcc_core::message::{CommandEntry, CommandState, DeviceState, EndReason, FaultRecord};
use rcc_protocol::control::{Answer, InputValue, Refusal};
use rcc_protocol::rules::Rule;

use super::Engine;
use super::command_table::{CommandRow, PendingTransition};
use super::handover::{Handover, HandoverRows};
use crate::boards::DeviceBoards;
use crate::net::Net;
use crate::queue::{EngineReply, EngineRequest, ValueReading};
use crate::record::TriggerReason;
use crate::rows::RowIndex;

impl<B: DeviceBoards> Engine<B> {
    pub(super) fn execute(&mut self, request: EngineRequest<B>) {
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
            EngineRequest::Start { ticket, id, lease } => {
                match self.accept_start(ticket, id, lease) {
                    // Answered after the first evaluation.
                    Ok(()) => return,
                    Err(refusal) => (ticket, Err(refusal)),
                }
            }
            // Answered after it was tried.
            EngineRequest::Handover {
                ticket,
                stop,
                start,
                lease,
            } => {
                return self.take_handover(Handover {
                    ticket,
                    stop,
                    start,
                    lease,
                    since_cycle: self.status.cycle,
                });
            }
            EngineRequest::Cancel { ticket, id } => {
                (ticket, self.cancel_by_client(id).map(|()| None))
            }
            EngineRequest::Abort { ticket, id } => {
                (ticket, self.abort_by_client(id).map(|()| None))
            }
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
            EngineRequest::InstallRules { ticket, rules } => {
                return self.answer_installation(ticket, rules);
            }
            EngineRequest::RemoveRule { ticket, id } => {
                (ticket, self.remove_rule(id).map(|()| None))
            }
            EngineRequest::ListRules {
                ticket,
                after,
                list,
            } => return self.list_rules(ticket, after, list),
            EngineRequest::GrantLease { ticket, expires_ns } => {
                (ticket, self.grant_lease(expires_ns).map(Some))
            }
            EngineRequest::RenewLease { ticket, lease } => {
                (ticket, self.renew_lease(lease).map(|()| None))
            }
            EngineRequest::EndLease { ticket, lease } => {
                (ticket, self.end_lease(lease).map(|()| None))
            }
            EngineRequest::BindLease {
                ticket,
                lease,
                commands,
            } => (ticket, self.bind_lease(lease, &commands).map(|()| None)),
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

    fn answer_installation(&mut self, ticket: u64, rules: Vec<Rule>) {
        let cycle = self.status.cycle;
        let answer = match self.install_rules(&rules) {
            Ok(first) => Answer::RulesInstalled { first, cycle },
            Err((0, refusal)) => Answer::Refused(refusal),
            Err((id, refusal)) => Answer::RefusedFor { id, refusal },
        };
        self.send_reply(EngineReply::RuleList(rules));
        self.send_reply(EngineReply::Answer { ticket, answer });
    }

    /// Freezes the recording on request.
    fn freeze(&mut self) -> Result<(), Refusal> {
        let recorder = self.recorder.as_mut().ok_or(Refusal::NoRecorder)?;
        recorder.trigger(TriggerReason::Request);
        Ok(())
    }

    /// Reserves a free row. In a full table the oldest rejected command is dropped: it can only be read, and a client
    /// that leaves its rejected commands there would keep all others from loading.
    fn reserve(&mut self) -> Result<u64, Refusal> {
        let free = RowIndex::all().find(|row| self.commands[*row].entry.id == 0);
        let row = free
            .or_else(|| self.oldest_rejected())
            .ok_or(Refusal::TableFull)?;
        let id = self.next_id;
        self.next_id += 1;
        self.commands[row].entry = CommandEntry {
            id,
            fault: FaultRecord::NONE,
            ..CommandEntry::zeroed()
        };
        (self.commands[row].lease, self.commands[row].lost_arms) = (0, 0);
        self.set_state(row, CommandState::Loading);
        Ok(id)
    }

    fn oldest_rejected(&self) -> Option<RowIndex> {
        let is_rejected = |row: &RowIndex| self.commands[*row].state() == CommandState::Rejected;
        RowIndex::all()
            .filter(is_rejected)
            .min_by_key(|row| self.commands[*row].entry.id)
    }

    fn install(&mut self, id: u64, net: Box<Net>) -> Result<(), Refusal> {
        match self
            .commands
            .find(id, |state| state == CommandState::Loading)
        {
            Ok(row) => {
                if net.subscribes() {
                    self.commands.subscribers.insert(row);
                }
                let CommandRow {
                    entry, net: place, ..
                } = &mut self.commands[row];
                entry.can_cancel = u32::from(net.can_cancel());
                entry.expected_ns = net.expected_ns;
                *place = Some(net);
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
        if let Ok(row) = self.commands.find(id, |state| state == CommandState::Ready)
            && let CommandRow {
                net: Some(old),
                pending: PendingTransition::Nothing,
                ..
            } = &mut self.commands[row]
        {
            std::mem::swap(net.inputs_mut(), old.inputs_mut());
            std::mem::swap(&mut net, old);
        }
        self.send_reply(EngineReply::Net(net));
    }

    fn reject(&mut self, id: u64) -> Result<(), Refusal> {
        let row = self
            .commands
            .find(id, |state| state == CommandState::Loading)?;
        self.set_state(row, CommandState::Rejected);
        Ok(())
    }

    fn accept_start(&mut self, ticket: u64, id: u64, lease: u64) -> Result<(), Refusal> {
        let row = self
            .commands
            .find(id, |state| state == CommandState::Ready)?;
        if self.stopping {
            return Err(Refusal::Stopping);
        }
        self.check_lease(row, lease)?;
        if self.commands[row].is_pending() {
            return Err(Refusal::WrongState {
                state: CommandState::Ready as u32,
            });
        }
        self.check_free(row, HandoverRows::NONE)?;
        self.check_topics(row, HandoverRows::NONE)?;
        self.check_devices(row, HandoverRows::NONE)?;
        self.check_budget(row, HandoverRows::NONE)?;
        self.commands[row].pending = PendingTransition::Start { ticket, lease };
        self.commands.busy.insert(row);
        Ok(())
    }

    /// Checks that no other active command holds a resource that this one claims, except for those that the hand-over
    /// stops. Commands that it starts count as holding theirs.
    pub(super) fn check_free(&self, row: RowIndex, sets: HandoverRows) -> Result<(), Refusal> {
        let claims = self.commands[row].claims();
        for other in self.other_active(row, sets) {
            if let Some(resource) = claims.common(other.claims()) {
                let holder = other.entry.id;
                return Err(Refusal::Busy { holder, resource });
            }
        }
        Ok(())
    }

    /// The other active commands, without those that the hand-over stops, and with those that it starts.
    pub(super) fn other_active(
        &self,
        row: RowIndex,
        sets: HandoverRows,
    ) -> impl Iterator<Item = &CommandRow> {
        let counts = move |other: &RowIndex| {
            let command = &self.commands[*other];
            let active = command.is_active() || command.is_pending();
            let counts = active && !sets.stop.contains(*other) || sets.start.contains(*other);
            *other != row && counts
        };
        let others = RowIndex::all().filter(counts);
        others.map(move |other| &self.commands[other])
    }

    /// Checks that each arm is ready, or is handed over by a command that the hand-over stops, and that no other device
    /// is offline.
    pub(super) fn check_devices(&self, row: RowIndex, sets: HandoverRows) -> Result<(), Refusal> {
        let command = &self.commands[row];
        for (index, (input, _)) in self.devices.iter().enumerate() {
            let state = self.devices.state(index);
            let ready = if command.claims_arm(index) {
                state == DeviceState::Ready
                    || state == DeviceState::Commanded && self.leaves_arm(index, sets.stop)
            } else {
                state != DeviceState::Offline
            };
            if command.claims().uses(index) && !ready {
                return Err(Refusal::DeviceNotReady {
                    device: index as u32,
                    state: state as u32,
                    reason: input.measurement.reason,
                });
            }
        }
        Ok(())
    }

    pub(super) fn cancel(&mut self, id: u64) -> Result<(), Refusal> {
        let row = self
            .commands
            .find(id, |state| state == CommandState::Running)?;
        match &mut self.commands[row].net {
            Some(net) if net.can_cancel() => net.cancel_requested = true,
            _ => return Err(Refusal::NotCancelable),
        }
        self.set_state(row, CommandState::Canceling);
        Ok(())
    }

    /// CANCEL: nothing may start the command after it. A START that waits for the net's first cycle is withdrawn.
    fn cancel_by_client(&mut self, id: u64) -> Result<(), Refusal> {
        self.disarm_after_stop(id);
        let withdrawn = self.withdraw_handover(id) | self.withdraw_start(id);
        match self.cancel(id) {
            // Nothing starts it any more: that is what was asked for.
            Err(refusal) if withdrawn && is_ready(refusal) => Ok(()),
            canceled => canceled,
        }
    }

    /// ABORT: as CANCEL, at once.
    fn abort_by_client(&mut self, id: u64) -> Result<(), Refusal> {
        self.disarm_after_stop(id);
        let withdrawn = self.withdraw_handover(id);
        if self.abort_before_first_cycle(id) {
            return Ok(());
        }
        match self.commands.find(id, CommandState::is_active) {
            Err(refusal) if withdrawn && is_ready(refusal) => Ok(()),
            Err(refusal) => Err(refusal),
            Ok(row) => {
                self.end(row, EndReason::Aborted, FaultRecord::NONE);
                Ok(())
            }
        }
    }

    /// Reads values as the last evaluation left them.
    fn read(&self, id: u64, reading: &mut ValueReading) -> Result<(), Refusal> {
        let row = self.commands.find(id, |_| true)?;
        let CommandRow { entry, net, .. } = &self.commands[row];
        let state = entry.state;
        let net = net.as_ref().ok_or(Refusal::WrongState { state })?;
        net.read(reading)?;
        reading.values.state = state;
        Ok(())
    }

    /// Stages values for the next evaluation of the net.
    fn set(&mut self, id: u64, values: Vec<InputValue>) -> Result<(), Refusal> {
        let allowed = |state: CommandState| state == CommandState::Ready || state.is_active();
        let row = self.commands.find(id, allowed);
        let set = row.and_then(|row| match &mut self.commands[row].net {
            Some(net) => net.set(&values),
            None => Err(Refusal::UnknownCommand),
        });
        self.send_reply(EngineReply::Values(values));
        set
    }

    fn unload(&mut self, id: u64) -> Result<(), Refusal> {
        let row = self.commands.find(id, |state| !state.is_active())?;
        if self.commands[row].is_pending() {
            return Err(Refusal::WrongState {
                state: CommandState::Running as u32,
            });
        }
        self.commands.subscribers.remove(row);
        self.commands[row].entry = CommandEntry::zeroed();
        if let Some(net) = self.commands[row].net.take() {
            self.send_reply(EngineReply::Net(net));
        }
        self.tables_changed = true;
        self.rules.commands_changed = true;
        Ok(())
    }

    /// Cancels every net that can be canceled, and aborts the others.
    pub(super) fn cancel_all(&mut self) {
        for row in RowIndex::all() {
            let command = &self.commands[row];
            let (id, state) = (command.entry.id, command.state());
            if state == CommandState::Running && self.cancel(id).is_err() {
                self.end(row, EndReason::Aborted, FaultRecord::NONE);
            }
        }
    }

    /// Aborts all active commands.
    pub fn abort_all(&mut self) {
        for row in RowIndex::all() {
            if self.commands[row].is_active() {
                self.end(row, EndReason::Aborted, FaultRecord::NONE);
            }
        }
    }
}

/// Returns true if a command was refused because it is ready.
fn is_ready(refusal: Refusal) -> bool {
    let state = CommandState::Ready as u32;
    refusal == Refusal::WrongState { state }
}
