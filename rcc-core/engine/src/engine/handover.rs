//! Hand-over: one request stops some commands and starts others between the same two cycles, or changes nothing.
//! Real-time thread.
//!
//! The request is checked and tried before any row of a cycle is evaluated: in the cycle that takes it or, with slower
//! nets, in the next one in which all nets that start are due. An arm that passes from one command to another stays
//! engaged: its driver sees one stream of set-points, and the guard continues with its history.

use rcc_core::frame::ArmMotion;
use rcc_core::message::{CommandState, DeviceState, EndReason, FaultCode, FaultRecord};
use rcc_protocol::control::{Answer, Refusal, SWITCH_MAX};

use super::Engine;
use super::command_table::PendingTransition;
use super::devices::Engagement;
use crate::boards::DeviceBoards;
use crate::net::Evaluation;
use crate::queue::EngineReply;
use crate::rows::{RowIndex, RowSet};

/// A hand-over that waits to be tried; unused ids are 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Handover {
    pub(super) ticket: u64,
    pub(super) stop: [u64; SWITCH_MAX],
    pub(super) start: [u64; SWITCH_MAX],
    /// The lease to which the commands that start are bound; 0: as they are bound already.
    pub(super) lease: u64,
    pub(super) since_cycle: u64,
}

/// Result of trying a hand-over in this cycle.
pub(super) enum HandoverOutcome {
    /// It was carried out.
    Done(HandoverRows),
    /// Not all nets that start are due.
    Waits,
    /// Nothing has changed.
    Refused(HandoverRefusal),
}

/// The rows that a hand-over stops and starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct HandoverRows {
    pub(super) stop: RowSet,
    pub(super) start: RowSet,
}

impl HandoverRows {
    /// No hand-over: a command starts beside the others.
    pub(super) const NONE: HandoverRows = HandoverRows {
        stop: RowSet::EMPTY,
        start: RowSet::EMPTY,
    };
}

/// Longest time that a hand-over waits for a cycle in which all nets that start are due.
const TOGETHER_MAX_NS: u64 = 1_000_000_000;

/// A refusal with the id of the command that it concerns; 0: none.
pub(super) type HandoverRefusal = (u64, Refusal);

impl<B: DeviceBoards> Engine<B> {
    /// Accepts a hand-over, unless another one still waits for its nets to be due. One that only stops takes effect at
    /// once.
    pub(super) fn take_handover(&mut self, mut handover: Handover) {
        if handover.start == [0; SWITCH_MAX] {
            for id in handover.stop.iter_mut().filter(|id| **id != 0) {
                self.disarm_after_stop(*id);
                let withdrawn = self.withdraw_handover(*id) | self.withdraw_start(*id);
                if withdrawn && self.is_ready(*id) {
                    *id = 0;
                }
            }
            let now_ns = self.status.stamp_ns;
            self.carry_out(handover, now_ns);
            return;
        }
        if self.handover.is_some() {
            return self.refuse_handover(handover.ticket, (0, Refusal::Overloaded));
        }
        self.handover = Some(handover);
    }

    /// A client stops this command: a hand-over that waits and names it is refused. Returns true if it would have
    /// started the command, which stays ready.
    pub(super) fn withdraw_handover(&mut self, id: u64) -> bool {
        let names =
            |handover: &mut Handover| handover.stop.contains(&id) || handover.start.contains(&id);
        let Some(handover) = self.handover.take_if(|handover| id != 0 && names(handover)) else {
            return false;
        };
        let [first, ..] = handover.start;
        let starts = handover.start.contains(&id);
        let withdrawn = if starts { id } else { first };
        self.refuse_handover(handover.ticket, (withdrawn, Refusal::Withdrawn));
        starts
    }

    /// Checks states, resources and devices.
    fn checked(&self, handover: &Handover) -> Result<HandoverRows, HandoverRefusal> {
        let stop = self.rows_of(&handover.stop, CommandState::is_active)?;
        let start = self.rows_of(&handover.start, |state| state == CommandState::Ready)?;
        if self.stopping && start != RowSet::EMPTY {
            return Err((0, Refusal::Stopping));
        }
        let sets = HandoverRows { stop, start };
        for row in start.rows() {
            let about = |refusal| (self.id_of(row), refusal);
            if self.commands[row].is_pending() {
                let state = CommandState::Ready as u32;
                return Err(about(Refusal::WrongState { state }));
            }
            self.check_free(row, sets).map_err(about)?;
            // Topics of a net that is not due yet are checked when it is due, and not in every cycle before.
            if self.is_due(row) {
                self.check_topics(row, sets).map_err(about)?;
            }
            self.check_devices(row, sets).map_err(about)?;
            self.check_budget(row, sets).map_err(about)?;
        }
        Ok(sets)
    }

    /// The rows of the commands with these ids, all of which must be in an allowed state; an id of 0 is skipped.
    fn rows_of(
        &self,
        ids: &[u64; SWITCH_MAX],
        allowed: impl Fn(CommandState) -> bool,
    ) -> Result<RowSet, HandoverRefusal> {
        let mut set = RowSet::EMPTY;
        for &id in ids.iter().filter(|id| **id != 0) {
            let row = self.commands.find(id, &allowed);
            let row = row.map_err(|refusal| (id, refusal))?;
            if set.contains(row) {
                return Err((id, Refusal::NamedTwice));
            }
            set.insert(row);
        }
        Ok(set)
    }

    fn is_ready(&self, id: u64) -> bool {
        let ready = |state| state == CommandState::Ready;
        self.commands.find(id, ready).is_ok()
    }

    fn id_of(&self, row: RowIndex) -> u64 {
        self.commands[row].entry.id
    }

    /// Returns true if a command in `leave` commands the arm of a device, or has ended while the arm plays its last
    /// set-points.
    pub(super) fn leaves_arm(&self, index: usize, leave: RowSet) -> bool {
        self.engaged_by(index, leave) || self.settled_by(index, leave)
    }

    fn engaged_by(&self, index: usize, leave: RowSet) -> bool {
        let device = self.devices.get(index);
        let engagement = device.and_then(|(_, device)| device.engagement);
        engagement.is_some_and(|engagement| leave.contains(engagement.row))
    }

    fn settled_by(&self, index: usize, leave: RowSet) -> bool {
        leave.rows().any(|row| {
            let row = &self.commands[row];
            matches!(row.pending, PendingTransition::Settle { .. }) && row.claims_arm(index)
        })
    }

    /// Tries the pending hand-over, if there is one, and answers it. Returns the rows that it evaluated.
    pub(super) fn try_handover(&mut self, now_ns: u64) -> RowSet {
        match self.handover.take() {
            Some(handover) => self.carry_out(handover, now_ns),
            None => RowSet::EMPTY,
        }
    }

    /// Tries a hand-over, and answers it unless it waits.
    fn carry_out(&mut self, handover: Handover, now_ns: u64) -> RowSet {
        let ticket = handover.ticket;
        let outcome = match self.check_leases(&handover) {
            Ok(()) => self.hand_over(&handover, now_ns),
            Err(refused) => HandoverOutcome::Refused(refused),
        };
        match outcome {
            HandoverOutcome::Done(sets) => {
                let cycle = self.status.cycle;
                let answer = Answer::Done { cycle };
                self.send_reply(EngineReply::Answer { ticket, answer });
                for row in sets.start.rows() {
                    self.bind_started(row, handover.lease);
                }
                return sets.start;
            }
            HandoverOutcome::Waits => self.handover = Some(handover),
            HandoverOutcome::Refused(refused) => self.refuse_handover(ticket, refused),
        }
        RowSet::EMPTY
    }

    /// Carries out a hand-over if it is possible in this cycle.
    pub(super) fn hand_over(&mut self, handover: &Handover, now_ns: u64) -> HandoverOutcome {
        let sets = match self.checked(handover) {
            Ok(sets) => sets,
            Err(refused) => return HandoverOutcome::Refused(refused),
        };
        if let Some(row) = sets.start.rows().find(|row| !self.is_due(*row)) {
            let waited_ns = (self.status.cycle - handover.since_cycle) * self.period_ns;
            return match waited_ns < TOGETHER_MAX_NS {
                true => HandoverOutcome::Waits,
                false => HandoverOutcome::Refused((self.id_of(row), Refusal::NeverTogether)),
            };
        }
        self.deliver(sets.start);
        match self.try_all(sets) {
            Ok(ended) => {
                self.complete(sets, ended, now_ns);
                HandoverOutcome::Done(sets)
            }
            Err(refused) => HandoverOutcome::Refused(refused),
        }
    }

    /// Evaluates all nets that start and passes their commands on; returns the rows that terminated in this cycle. If
    /// one cannot start, everything is restored.
    fn try_all(&mut self, sets: HandoverRows) -> Result<RowSet, HandoverRefusal> {
        let next_engagement = self.next_engagement;
        for (_, device) in self.devices.iter_mut() {
            device.begin_handover();
        }
        let mut ended = RowSet::EMPTY;
        for row in sets.start.rows() {
            match self.try_first(row, sets.stop) {
                Ok(Evaluation::Terminated) => ended.insert(row),
                Ok(_) => {}
                Err(refusal) => {
                    self.next_engagement = next_engagement;
                    self.undo(sets.start);
                    return Err((self.id_of(row), refusal));
                }
            }
        }
        Ok(ended)
    }

    /// Ends the commands that leave and commits the first cycle of those that start.
    fn complete(&mut self, sets: HandoverRows, ended: RowSet, now_ns: u64) {
        for row in sets.stop.rows() {
            self.leave(row);
        }
        for row in sets.start.rows() {
            let evaluation = match ended.contains(row) {
                true => Evaluation::Terminated,
                false => Evaluation::Running,
            };
            self.commit_start(row, evaluation, now_ns);
        }
    }

    /// The first evaluation of a row that takes over from the commands in `leave`.
    fn try_first(&mut self, row: RowIndex, leave: RowSet) -> Result<Evaluation, Refusal> {
        self.begin_from(row, leave);
        let evaluation = self.evaluate(row);
        self.account_net(row);
        self.time.end_nets();
        if let Evaluation::Fault(code) = evaluation {
            return Err(Refusal::FirstCycle { code: code as u32 });
        }
        let mut taken = 0u64;
        for index in 0..self.devices.len() {
            let claimed = self.commands[row].claims_arm(index);
            let takes = claimed && self.take_over(row, index, leave)?;
            taken |= u64::from(takes) << index;
        }
        let passed = self.pass_commands(row, false);
        passed.map_err(|fault| match taken.checked_shr(fault.device) {
            Some(bits) if bits & 1 == 1 => self.discontinued(fault),
            _ => self.refusal_of(fault),
        })?;
        Ok(evaluation)
    }

    /// Sets the motion that each arm of the net in `row` starts with: that of a command in `leave`, or rest.
    pub(super) fn begin_from(&mut self, row: RowIndex, leave: RowSet) {
        for index in 0..self.devices.len() {
            if !self.commands[row].claims_arm(index) {
                continue;
            }
            let Some((input, device)) = self.devices.get(index) else {
                continue;
            };
            let last = device.guard.motion();
            let motion = match last {
                Some(last) if self.engaged_by(index, leave) => last,
                Some(last) if self.settled_by(index, leave) => ArmMotion::at_rest(last.position),
                _ if input.present => ArmMotion::at_rest(input.measurement.hold),
                _ => continue,
            };
            if let Some(net) = &mut self.commands[row].net {
                net.take_arm(index, motion);
            }
        }
    }

    /// Engages the row with an arm that a command in `leave` commands or has just released. Returns false if there is
    /// no such command; the arm must then rest at its hold set-point.
    fn take_over(&mut self, row: RowIndex, index: usize, leave: RowSet) -> Result<bool, Refusal> {
        let engaged = self.engaged_by(index, leave);
        let settled =
            self.devices.state(index) == DeviceState::Commanded && self.settled_by(index, leave);
        if !engaged && !settled {
            return Ok(false);
        }
        let net = self.commands[row].net.as_ref();
        let output = net.and_then(|net| net.outputs().get(index));
        let Some((output, (_, device))) = output.zip(self.devices.get_mut(index)) else {
            return Ok(false);
        };
        let number = index as u32;
        if !output.has_position {
            return Err(Refusal::LetsGo { device: number });
        }
        if let Some(engagement) = &mut device.engagement {
            engagement.row = row;
            return Ok(true);
        }
        if !device.guard.rests() {
            // The command ended in motion: its driver will brake, and the rest position of the arm is unknown.
            return Err(Refusal::DeviceNotReady {
                device: number,
                state: DeviceState::Commanded as u32,
                reason: 0,
            });
        }
        let resumed = device.guard.resume(&output.position);
        resumed.map_err(|violation| Refusal::Continuation {
            device: number,
            joint: u32::from(violation.joint) + 1,
            value: violation.value,
            limit: violation.limit,
            violation: violation.kind.number(),
        })?;
        let since_cycle = self.status.cycle;
        device.engagement = Some(Engagement {
            row,
            number: self.next_engagement,
            since_cycle,
            followed: false,
            follows_from_ns: since_cycle * self.period_ns,
        });
        self.next_engagement += 1;
        Ok(true)
    }

    /// The refusal for a first set-point that does not continue the previous ones.
    fn discontinued(&self, fault: FaultRecord) -> Refusal {
        if fault.code == FaultCode::DeviceLost as u32 {
            return self.refusal_of(fault);
        }
        Refusal::Continuation {
            device: fault.device,
            joint: fault.joint,
            value: fault.value,
            limit: fault.limit,
            violation: fault.violation,
        }
    }

    /// Restores the state before the hand-over was tried.
    fn undo(&mut self, start: RowSet) {
        for (_, device) in self.devices.iter_mut() {
            device.undo_handover();
        }
        for row in start.rows() {
            self.reset_to_ready(row);
        }
    }

    /// Ends a row in a hand-over: its last cycle was the previous one.
    fn leave(&mut self, row: RowIndex) {
        if matches!(self.commands[row].pending, PendingTransition::Settle { .. }) {
            return self.finish(row);
        }
        self.commands[row].entry.ended_cycle = self.status.cycle - 1;
        self.end(row, EndReason::Aborted, FaultRecord::NONE);
    }

    fn refuse_handover(&mut self, ticket: u64, (id, refusal): HandoverRefusal) {
        let answer = match id {
            0 => Answer::Refused(refusal),
            id => Answer::RefusedFor { id, refusal },
        };
        self.send_reply(EngineReply::Answer { ticket, answer });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::EngineConfig;
    use crate::net::tests::endless;
    use crate::queue::{EngineRequest, rings};

    #[test]
    fn a_fault_in_the_first_evaluation_changes_nothing() {
        let (rt, mut rings) = rings();
        let config = EngineConfig {
            incarnation: 1,
            first_id: 1,
            period_ns: 1_000_000,
            stale_after_ns: 50_000_000,
            late_in_a_row_max: 3,
            models: Vec::new(),
        };
        let mut engine = Engine::new(config, rt);
        let mut ask = |engine: &mut Engine, request: EngineRequest| {
            rings.requests.push(request).unwrap();
            engine.cycle(1);
            match rings.replies.pop() {
                Ok(EngineReply::Answer { answer, .. }) => answer,
                other => panic!("{other:?}"),
            }
        };
        let ticket = 1;
        for (id, panics) in [(1, false), (2, false), (3, true)] {
            let mut net = endless();
            net.panics = panics;
            ask(&mut engine, EngineRequest::Reserve { ticket });
            ask(&mut engine, EngineRequest::Install { ticket, id, net });
        }
        ask(
            &mut engine,
            EngineRequest::Start {
                ticket,
                id: 1,
                lease: 0,
            },
        );
        let mut handover = |engine: &mut Engine, ids: &[u64]| {
            let (mut stop, mut start) = ([0; SWITCH_MAX], [0; SWITCH_MAX]);
            stop[0] = 1;
            start[..ids.len()].copy_from_slice(ids);
            let request = EngineRequest::Handover {
                ticket,
                stop,
                start,
                lease: 0,
            };
            ask(engine, request)
        };
        let refusal = Refusal::FirstCycle {
            code: FaultCode::Panic as u32,
        };
        assert_eq!(
            handover(&mut engine, &[2, 3]),
            Answer::RefusedFor { id: 3, refusal }
        );
        let row = |engine: &Engine, row: usize| {
            let entry = engine.tables().commands[row];
            (CommandState::from_number(entry.state), entry.cycles)
        };
        assert_eq!(row(&engine, 0), (CommandState::Running, 2));
        assert_eq!(row(&engine, 1), (CommandState::Ready, 0));
        assert_eq!(row(&engine, 2), (CommandState::Ready, 0));
        let cycle = engine.status().cycle + 1;
        assert_eq!(handover(&mut engine, &[2]), Answer::Done { cycle });
    }
}
