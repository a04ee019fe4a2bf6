//! The life cycle of commands (figure 2 of the paper): evaluation of rows, and termination. Real-time thread.

use rcc_core::message::{CommandState, EndReason, FaultCode, FaultRecord};
use rcc_protocol::control::{Answer, Refusal};

use super::command_table::{CommandRow, PendingTransition};
use super::{Engine, SETTLE_MAX_NS};
use crate::boards::DeviceBoards;
use crate::net::{Evaluation, monitor_record};
use crate::queue::{EngineEvent, EngineReply};
use crate::record::EvaluationRecord;
use crate::rows::{RowIndex, RowSet};

impl<B: DeviceBoards> Engine<B> {
    /// One cycle of one row of the command table.
    pub(super) fn run_row(&mut self, row: RowIndex, now_ns: u64) {
        let active = self.commands[row].is_active();
        match self.commands[row].pending {
            PendingTransition::Settle { since_cycle } => self.settle(row, since_cycle),
            PendingTransition::Start { ticket, lease } if self.is_due(row) => {
                self.first_cycle(row, (ticket, lease), now_ns)
            }
            PendingTransition::Start { ticket, .. } => self.await_first_cycle(row, ticket),
            PendingTransition::Nothing if active && self.is_due(row) => {
                self.next_cycle(row, now_ns)
            }
            PendingTransition::Nothing if active => self.between_cycles(row),
            PendingTransition::Nothing => {}
        }
    }

    /// The fault of the net in `row` if a device that it uses is lost and it does not handle device loss.
    pub(super) fn device_loss_fault(&self, row: RowIndex) -> Option<FaultRecord> {
        let lost = self.lost_device(row)?;
        (!self.commands[row].survives_device_loss()).then(|| FaultRecord {
            device: lost as u32,
            ..self.fault(FaultCode::DeviceLost)
        })
    }

    fn next_cycle(&mut self, row: RowIndex, now_ns: u64) {
        let survives = self.commands[row].survives_device_loss();
        if let Some(fault) = self.device_loss_fault(row) {
            return self.end(row, EndReason::Fault, fault);
        }
        match self.evaluate(row) {
            Evaluation::Fault(code) => self.end(row, EndReason::Fault, self.fault(code)),
            evaluation => match self.pass_commands(row, survives) {
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
    fn first_cycle(&mut self, row: RowIndex, (ticket, lease): (u64, u64), now_ns: u64) {
        self.commands[row].pending = PendingTransition::Nothing;
        if let Some(refusal) = self.lost_while_waiting(row) {
            self.reset_to_ready(row);
            let answer = Answer::Refused(refusal);
            return self.send_reply(EngineReply::Answer { ticket, answer });
        }
        let cycle = self.status.cycle;
        self.begin_from(row, RowSet::EMPTY);
        let refusal = match self.evaluate(row) {
            Evaluation::Fault(code) => {
                self.set_state(row, CommandState::Running);
                self.end(row, EndReason::Fault, self.fault(code));
                Some(Refusal::FirstCycle { code: code as u32 })
            }
            evaluation => match self.pass_commands(row, false) {
                Ok(()) => {
                    self.bind_started(row, lease);
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
    pub(super) fn commit_start(&mut self, row: RowIndex, evaluation: Evaluation, now_ns: u64) {
        self.commands[row].entry.started_cycle = self.status.cycle;
        self.set_state(row, CommandState::Running);
        self.publish(row);
        self.push_monitors(row, now_ns);
        if evaluation == Evaluation::Terminated {
            self.terminate(row);
        }
    }

    /// Restores the state of a ready row whose first evaluation was not accepted.
    pub(super) fn reset_to_ready(&mut self, row: RowIndex) {
        let CommandRow { entry, net, .. } = &mut self.commands[row];
        if let Some(net) = net {
            net.reset_after_refused_start();
        }
        (entry.cycles, entry.exec_sum_ns) = (0, 0);
        (entry.exec_last_ns, entry.exec_max_ns) = (0, 0);
    }

    pub(super) fn refusal_of(&self, fault: FaultRecord) -> Refusal {
        if fault.code == FaultCode::DeviceLost as u32 {
            let index = fault.device as usize;
            let device = self.devices.get(index);
            return Refusal::DeviceNotReady {
                device: fault.device,
                state: self.devices.state(index) as u32,
                reason: device.map_or(0, |(input, _)| input.measurement.reason),
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

    pub(super) fn evaluate(&mut self, row: RowIndex) -> Evaluation {
        let CommandRow {
            entry,
            net: Some(net),
            next_timed_run,
            ..
        } = &mut self.commands[row]
        else {
            return Evaluation::Fault(FaultCode::Panic);
        };
        let (begins, cancel) = (net.cycles == 0, net.cancel_requested);
        if let Some(recorder) = &mut self.recorder {
            for (input, words, late) in net.inputs().staged_values() {
                recorder.set(entry.id, input, words, late);
            }
            // Only a first evaluation takes over arms.
            let taken = begins.then(|| net.taken_arms());
            for (device, motion) in taken.into_iter().flatten() {
                recorder.arm(entry.id, device, motion);
            }
        }
        let timed = (&mut **net, next_timed_run);
        let (models, inputs) = self.devices.slices();
        let evaluation = (self.time).evaluate(row, timed, (models, inputs), self.dt_s);
        net.evaluated_cycle = self.status.cycle;
        entry.cycles = net.cycles;
        if let Some(recorder) = &mut self.recorder {
            let evaluated = EvaluationRecord {
                row,
                id: entry.id,
                net,
                evaluation,
                begins,
                cancel,
                dt_s: self.dt_s,
            };
            recorder.net(evaluated, inputs);
        }
        evaluation
    }

    /// Accounts for the time of the net in `row` if it was evaluated; for none that was refused in its first cycle.
    pub(super) fn account_net(&mut self, row: RowIndex) {
        let Some(exec_ns) = self.time.end_net() else {
            return;
        };
        let entry = &mut self.commands[row].entry;
        if entry.cycles == 0 {
            return;
        }
        entry.exec_last_ns = exec_ns;
        entry.exec_max_ns = entry.exec_max_ns.max(exec_ns);
        entry.exec_sum_ns += exec_ns;
        self.time.record_duration(entry.id, exec_ns);
    }

    /// Sends the monitors that are due to the pump thread.
    fn push_monitors(&mut self, row: RowIndex, now_ns: u64) {
        let CommandRow {
            entry,
            net: Some(net),
            ..
        } = &self.commands[row]
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
    fn terminate(&mut self, row: RowIndex) {
        let since_cycle = self.status.cycle;
        self.commands[row].entry.ended_cycle = since_cycle;
        if self.commands[row].claims().arms != 0 {
            self.commands[row].pending = PendingTransition::Settle { since_cycle };
            self.unpublish(row);
        } else {
            self.finish(row);
        }
    }

    fn settle(&mut self, row: RowIndex, since_cycle: u64) {
        self.disengage(row);
        let waited_ns = (self.status.cycle - since_cycle) * self.period_ns;
        // The driver receives the first image without a position in the cycle after the last evaluation.
        let settled_ns = (since_cycle + 1) * self.period_ns;
        if self.commands[row].survives_device_loss() {
            let gone = self.commands[row].claims().arms & self.devices.offline();
            self.commands[row].lost_arms |= gone;
        }
        let Some(unsettled) = self.unsettled_arm(row, settled_ns) else {
            return self.finish(row);
        };
        let unsettled = (waited_ns > SETTLE_MAX_NS).then(|| FaultRecord {
            device: unsettled as u32,
            ..self.fault(FaultCode::DeviceLost)
        });
        if let Some(fault) = self.device_loss_fault(row).or(unsettled) {
            self.end(row, EndReason::Fault, fault);
        }
    }

    pub(super) fn finish(&mut self, row: RowIndex) {
        let net = self.commands[row].net.as_ref();
        let outcome = net.map_or(0, |net| net.outcome + 1);
        let reason = match net.is_some_and(|net| net.cancel_requested) {
            true => EndReason::Canceled,
            false => EndReason::Finished,
        };
        self.commands[row].entry.outcome = outcome;
        self.end(row, reason, FaultRecord::NONE);
    }

    /// Terminates a row in any state. Outputs that were passed on in this cycle stay written; from the next cycle on
    /// nothing is commanded.
    pub(super) fn end(&mut self, row: RowIndex, reason: EndReason, fault: FaultRecord) {
        self.commands[row].pending = PendingTransition::Nothing;
        self.commands.subscribers.remove(row);
        self.unpublish(row);
        self.disengage(row);
        let entry = &mut self.commands[row].entry;
        (entry.reason, entry.fault) = (reason as u32, fault);
        if entry.ended_cycle == 0 {
            entry.ended_cycle = self.status.cycle;
        }
        self.set_state(row, CommandState::Terminated);
    }

    pub(super) fn set_state(&mut self, row: RowIndex, state: CommandState) {
        if state.is_active() {
            self.commands.busy.insert(row);
        }
        let entry = &mut self.commands[row].entry;
        entry.state = state as u32;
        if let Some(recorder) = &mut self.recorder {
            recorder.state(entry.id, entry.state, entry.reason, &entry.fault);
        }
        let event = EngineEvent::Command {
            cycle: self.status.cycle,
            id: entry.id,
            state: entry.state,
            reason: entry.reason,
            outcome: entry.outcome,
            cycles: entry.cycles,
            fault: entry.fault,
        };
        self.tables_changed = true;
        self.rules.commands_changed = true;
        self.log(event);
    }
}
