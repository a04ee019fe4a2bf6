//! Rules: judged in every cycle after its requests were taken and before any net is evaluated, on what the previous
//! cycle left and the requests changed. What follows is a hand-over and takes effect in the same cycle. Real-time
//! thread.
//!
//! All conditions are judged before any rule fires; then rules fire in the order of their ids. What a rule changes is
//! seen by the conditions of the next cycle, and by the checks of the rules that fire after it.

use rcc_core::message::{CommandState, EndReason};
use rcc_core::types::NULL_BOOL;
use rcc_protocol::control::{Refusal, SWITCH_MAX};
use rcc_protocol::rules::{
    DisarmReason, RULE_TERMS_MAX, RULES_MAX, RULES_PER_CYCLE, Rule, RuleFault, RuleRecording,
    RuleState, RuleStatus, RuleTerm,
};

use super::Engine;
use super::command_table::PendingTransition;
use super::handover::{Handover, HandoverOutcome};
use super::rule_checks::{RuleRefusal, can_fire, ids};
use super::rule_table::{InstalledRule, disarmed};
use crate::boards::DeviceBoards;
use crate::queue::{EngineEvent, EngineReply};
use crate::record::TriggerReason;
use crate::rows::{RowIndex, RowSet};
use crate::rule::{CommandFacts, Judgement, TruthSet, judge};
use crate::rule_set::{RuleSet, contains, insert};

/// Result of trying to fire a rule that is due.
enum Firing {
    Fired(RowSet),
    Waits,
    Refused(RuleRefusal),
}

impl<B: DeviceBoards> Engine<B> {
    /// Installs all of these rules, or none; returns the id of the first.
    pub(super) fn install_rules(&mut self, rules: &[Rule]) -> Result<u64, RuleRefusal> {
        let fault = |fault| (0, Refusal::Rule { index: 0, fault });
        self.rules.check_room(rules.len()).map_err(fault)?;
        if self.stopping {
            return Err((0, Refusal::Stopping));
        }
        for (rule, index) in rules.iter().zip(0..) {
            self.check_rule(index, rule)?;
        }
        let first = self.rules.next_id();
        for rule in rules {
            let rows = self.rows_of_terms(rule);
            if let Some((slot, _)) = self.rules.install(rule, rows, self.status.cycle) {
                self.record_rule(slot);
            }
        }
        Ok(first)
    }

    pub(super) fn rows_of_terms(&self, rule: &Rule) -> [RowIndex; RULE_TERMS_MAX] {
        let mut rows = [RowIndex::FIRST; RULE_TERMS_MAX];
        for (place, term) in rows.iter_mut().zip(rule.terms()) {
            let row = term.command().map(|id| self.commands.find(id, |_| true));
            *place = row.and_then(Result::ok).unwrap_or(RowIndex::FIRST);
        }
        rows
    }

    /// Facts for conditions about the command with this id, which was in `row` when the rule was installed.
    pub(super) fn facts(&self, id: u64, row: RowIndex) -> CommandFacts {
        let command = &self.commands[row];
        let entry = &command.entry;
        if entry.id != id {
            return CommandFacts::MISSING;
        }
        let mut facts = CommandFacts {
            state: command.state(),
            reason: EndReason::from_number(entry.reason),
            outcome: entry.outcome,
        };
        if let (PendingTransition::Settle { .. }, Some(net)) = (command.pending, &command.net) {
            facts.outcome = net.outcome + 1;
            facts.reason = match net.cancel_requested {
                true => EndReason::Canceled,
                false => EndReason::Finished,
            };
        }
        facts
    }

    fn judge_term(&self, term: &RuleTerm, row: RowIndex) -> Judgement {
        if let RuleTerm::Topic { topic } = *term {
            let source = self.topics.find(topic);
            let value = source.and_then(|source| {
                let net = self.commands[source.row].net.as_deref()?;
                net.published_bool(source.publish)
            });
            return Judgement::changing(TruthSet::of_slot(value.unwrap_or(NULL_BOOL)));
        }
        let Some(id) = term.command() else {
            return Judgement::fixed(TruthSet::NULL);
        };
        let net = self.commands[row].net.as_deref();
        let slot = match (*term, net) {
            (RuleTerm::Value { slot, .. }, Some(net)) => net.bool_at(slot),
            (
                RuleTerm::Compare {
                    slot,
                    relation,
                    limit,
                    ..
                },
                Some(net),
            ) => Some(net.compared(slot, relation, limit)),
            _ => None,
        };
        self.facts(id, row).judge(term, slot.unwrap_or(NULL_BOOL))
    }

    pub(super) fn judge_rule(
        &self,
        rule: &Rule,
        rows: &[RowIndex; RULE_TERMS_MAX],
    ) -> Option<Judgement> {
        judge(rule.terms(), |index, term| {
            let row = rows.get(index).copied().unwrap_or(RowIndex::FIRST);
            self.judge_term(term, row)
        })
    }

    /// Judges the conditions of all armed rules. The flight recorder gets the judgements
    /// before the ends of rules that follow from them.
    pub(super) fn judge_rules(&mut self) {
        if self.rules.is_quiet() {
            return;
        }
        let recheck = std::mem::take(&mut self.rules.commands_changed);
        let (mut judged, mut held): (RuleSet, RuleSet) = Default::default();
        for slot in 0..RULES_MAX {
            let Some(judgement) = self.judge_slot(slot) else {
                continue;
            };
            insert(&mut judged, slot);
            if judgement.holds() {
                insert(&mut held, slot);
            }
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.rules_judged(judged, held);
        }
        for slot in (0..RULES_MAX).filter(|slot| contains(&judged, *slot)) {
            self.act_on(slot, contains(&held, slot), recheck);
        }
        self.record_next_rule();
    }

    /// Judges the condition of an armed rule.
    fn judge_slot(&self, slot: usize) -> Option<Judgement> {
        let installed = self.rules.get(slot)?;
        let armed = installed.status.id != 0 && installed.status.state == RuleState::Armed;
        armed.then(|| self.judge_rule(&installed.rule, &installed.rows))?
    }

    /// Acts on the judgement of an armed rule: it records or is due, or it expires if commands have changed so
    /// that it can never fire.
    fn act_on(&mut self, slot: usize, holds: bool, recheck: bool) {
        let Some(&InstalledRule { rule, .. }) = self.rules.get(slot) else {
            return;
        };
        match rule.record {
            Some(recording) => self.record_by_rule(slot, &recording, holds),
            None if holds => return self.make_due(slot),
            None => {}
        }
        if recheck
            && let Some(judgement) = self.judge_slot(slot)
            && let Some(refusal) = self.never_fires(slot, &rule, judgement)
        {
            self.end_rule(slot, RuleState::Expired, Some(refusal));
        }
    }

    fn make_due(&mut self, slot: usize) {
        let cycle = self.status.cycle;
        if let Some(installed) = self.rules.get_mut(slot) {
            installed.status.state = RuleState::Due;
            installed.since_cycle = cycle;
        }
    }

    /// Freezes the recording if the condition of a rule that records has become true.
    fn record_by_rule(&mut self, slot: usize, recording: &RuleRecording, holds: bool) {
        let cycle = self.status.cycle;
        let distance = recording.distance_ns.checked_div(self.period_ns);
        let Some(installed) = self.rules.get_mut(slot) else {
            return;
        };
        let became_true = holds && !installed.held;
        installed.held = holds;
        if !became_true {
            return;
        }
        let status = &mut installed.status;
        let passed = cycle.saturating_sub(status.recorded_cycle);
        if status.recordings > 0 && passed < distance.unwrap_or(0) {
            status.skipped = status.skipped.saturating_add(1);
            return;
        }
        status.recordings = status.recordings.saturating_add(1);
        status.recorded_cycle = cycle;
        let (id, is_last) = (status.id, status.recordings >= recording.times);
        if let Some(recorder) = &mut self.recorder {
            recorder.trigger(TriggerReason::Rule { id });
        }
        if is_last {
            self.end_rule(slot, RuleState::Fired, None);
        }
    }

    /// Why a rule can never fire any more; `None` if it can.
    fn never_fires(&self, slot: usize, rule: &Rule, judgement: Judgement) -> Option<RuleRefusal> {
        let held = self.rules.get(slot).is_some_and(|rule| rule.held);
        if !can_fire(rule, judgement, held) {
            let (index, fault) = (0, RuleFault::NeverFires);
            return Some((0, Refusal::Rule { index, fault }));
        }
        let ready = |state| state == CommandState::Ready;
        ids(&rule.start).find_map(|id| {
            let refused = self.commands.find(id, ready).err()?;
            Some((id, refused))
        })
    }

    /// Fires the rules that are due. `evaluated` are the rows that a hand-over started in this cycle; returns them and
    /// those that rules started.
    pub(super) fn fire_rules(&mut self, evaluated: RowSet, now_ns: u64) -> RowSet {
        if self.rules.is_quiet() {
            return evaluated;
        }
        // Commands that were stopped or started in this cycle are left alone until the next one.
        let (mut touched, mut started) = (evaluated, evaluated);
        let mut last = 0;
        for _ in 0..RULES_PER_CYCLE {
            let due = |installed: &InstalledRule| installed.status.state == RuleState::Due;
            let Some(slot) = self.rules.next_after(last, due) else {
                break;
            };
            let Some(&InstalledRule {
                rule,
                since_cycle,
                status,
                ..
            }) = self.rules.get(slot)
            else {
                break;
            };
            last = status.id;
            match self.fire(&rule, since_cycle, &mut touched, now_ns) {
                Firing::Fired(rows) => {
                    for row in rows.rows() {
                        started.insert(row);
                    }
                    self.end_rule(slot, RuleState::Fired, None);
                }
                Firing::Waits => {}
                Firing::Refused(refusal) => {
                    self.end_rule(slot, RuleState::Refused, Some(refusal));
                }
            }
        }
        started
    }

    fn fire(&mut self, rule: &Rule, since_cycle: u64, touched: &mut RowSet, now_ns: u64) -> Firing {
        let is_touched = |id: u64| {
            let row = self.commands.find(id, |_| true);
            row.is_ok_and(|row| touched.contains(row))
        };
        if rule.targets().any(is_touched) {
            return Firing::Waits;
        }
        if let Some(refusal) = ids(&rule.cancel).find_map(|id| self.cannot_cancel(id)) {
            return Firing::Refused(refusal);
        }
        let handover = Handover {
            ticket: 0,
            stop: self.still_active(rule),
            start: rule.start,
            lease: 0,
            since_cycle,
        };
        let sets = match self.hand_over(&handover, now_ns) {
            HandoverOutcome::Done(sets) => sets,
            HandoverOutcome::Waits => return Firing::Waits,
            HandoverOutcome::Refused(refusal) => return Firing::Refused(refusal),
        };
        for row in sets.start.rows() {
            touched.insert(row);
            self.commands[row].lease = if rule.goes_on { 0 } else { rule.lease };
        }
        for row in sets.stop.rows() {
            touched.insert(row);
        }
        for id in ids(&rule.cancel) {
            // A refusal means that the command has ended or is being canceled; everything else was checked above.
            if let Ok(row) = self.commands.find(id, |_| true) {
                let _: Result<(), Refusal> = self.cancel(id);
                touched.insert(row);
            }
        }
        Firing::Fired(sets.start)
    }

    /// Why a command that a rule cancels cannot be canceled now; `None` if it can, or need not be.
    fn cannot_cancel(&self, id: u64) -> Option<RuleRefusal> {
        let too_early = |state: CommandState| state != CommandState::Ready;
        match self.commands.find(id, too_early) {
            Err(refusal @ Refusal::WrongState { .. }) => Some((id, refusal)),
            _ => None,
        }
    }

    /// The commands that a rule stops and that are still active; also those that have ended but whose arms still play the
    /// last set-points, if a command that the rule starts needs such an arm.
    fn still_active(&self, rule: &Rule) -> [u64; SWITCH_MAX] {
        let mut list = [0; SWITCH_MAX];
        let mut places = list.iter_mut();
        let mut add = |id: u64| {
            if let Some(place) = places.next() {
                *place = id;
            }
        };
        let active = |id: &u64| self.commands.find(*id, CommandState::is_active).is_ok();
        ids(&rule.stop).filter(active).for_each(&mut add);
        let starts = |row: &RowIndex| {
            let claims = self.commands[*row].claims();
            ids(&rule.start).any(|id| {
                let row = self.commands.find(id, |_| true);
                row.is_ok_and(|row| self.commands[row].claims().common(claims).is_some())
            })
        };
        for row in self.commands.busy.rows() {
            let (command, id) = (&self.commands[row], self.commands[row].entry.id);
            let settles = matches!(command.pending, PendingTransition::Settle { .. });
            if settles && !ids(&rule.stop).any(|stop| stop == id) && starts(&row) {
                add(id);
            }
        }
        list
    }

    fn end_rule(&mut self, slot: usize, state: RuleState, refusal: Option<RuleRefusal>) {
        let cycle = self.status.cycle;
        let ended = self.rules.end(slot, |status| {
            (status.state, status.cycle, status.refusal) = (state, cycle, refusal);
        });
        self.report_rule(slot, ended);
    }

    fn report_rule(&mut self, slot: usize, ended: Option<RuleStatus>) {
        let Some(status) = ended else { return };
        if let Some(recorder) = &mut self.recorder {
            recorder.rule_ended(slot, &status);
        }
        self.log(EngineEvent::Rule(status));
    }

    /// Disarms all rules that `which` accepts; returns their number.
    pub(super) fn disarm_where(
        &mut self,
        reason: DisarmReason,
        which: impl Fn(&Rule) -> bool,
    ) -> u32 {
        let mut count = 0;
        if self.rules.is_quiet() {
            return count;
        }
        for slot in 0..RULES_MAX {
            let wanted = |installed: &InstalledRule| {
                installed.status.state.is_pending() && which(&installed.rule)
            };
            if self.rules.get(slot).is_some_and(wanted) {
                let ended = self.rules.end(slot, disarmed(self.status.cycle, reason));
                count += u32::from(ended.is_some());
                self.report_rule(slot, ended);
            }
        }
        count
    }

    /// A client stops this command: rules must not start anything after it. Disarms each rule that starts a
    /// command and names the stopped one, or whose started command needs a resource of the stopped one.
    pub(super) fn disarm_after_stop(&mut self, id: u64) {
        let Ok(stopped) = self.commands.find(id, |_| true) else {
            return;
        };
        if self.rules.is_quiet() {
            return;
        }
        let mut rivals = RowSet::EMPTY;
        let claims = *self.commands[stopped].claims();
        for row in RowIndex::all() {
            if self.commands[row].claims().common(&claims).is_some() {
                rivals.insert(row);
            }
        }
        let mut starters = [0u64; rcc_core::message::COMMANDS_MAX];
        for row in rivals.rows() {
            if let Some(place) = starters.get_mut(row.number()) {
                *place = self.commands[row].entry.id;
            }
        }
        let reason = DisarmReason::Stopped { command: id };
        self.disarm_where(reason, |rule| {
            let needs = |start: u64| starters.contains(&start);
            rule.starts() && (rule.names(id) || ids(&rule.start).any(needs))
        });
    }

    /// Removes a rule from the table; one that could still fire is disarmed.
    pub(super) fn remove_rule(&mut self, id: u64) -> Result<(), Refusal> {
        let slot = self.rules.find(id).ok_or(Refusal::UnknownRule)?;
        let removed = disarmed(self.status.cycle, DisarmReason::Removed);
        let ended = self.rules.end(slot, removed);
        self.report_rule(slot, ended);
        self.rules.free(slot);
        Ok(())
    }

    /// Copies the rules with ids above `after` into the list, as many as there is room for, ascending.
    pub(super) fn list_rules(
        &mut self,
        ticket: u64,
        after: u64,
        mut list: Vec<(Rule, RuleStatus)>,
    ) {
        let mut last = after;
        for _ in 0..RULES_MAX {
            if list.len() == list.capacity() {
                break;
            }
            let Some(installed) = self
                .rules
                .next_after(last, |_| true)
                .and_then(|slot| self.rules.get(slot))
            else {
                break;
            };
            last = installed.status.id;
            list.push((installed.rule, installed.status));
        }
        self.send_reply(EngineReply::Rules { ticket, list });
    }

    /// Records a rule with what it sees of its commands, so that replay knows both from here on.
    fn record_rule(&mut self, slot: usize) {
        let Some(installed) = self.rules.get(slot) else {
            return;
        };
        let mut facts = [0; RULE_TERMS_MAX];
        let terms = installed.rule.terms().zip(installed.rows);
        for (place, (term, row)) in facts.iter_mut().zip(terms) {
            let command = term.command();
            *place = command.map_or(0, |id| self.facts(id, row).word());
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.rule(slot, installed.status.id, &installed.rule, &facts);
        }
    }

    /// Records one armed rule again, each in its turn: the ring may have overwritten the first record.
    fn record_next_rule(&mut self) {
        let slot = usize::try_from(self.status.cycle % RULES_MAX as u64).unwrap_or(0);
        let armed = |installed: &InstalledRule| {
            installed.status.id != 0 && installed.status.state == RuleState::Armed
        };
        if self.recorder.is_some() && self.rules.get(slot).is_some_and(armed) {
            self.record_rule(slot);
        }
    }
}
