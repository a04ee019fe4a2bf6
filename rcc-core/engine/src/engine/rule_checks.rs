//! Checks a rule before it is installed, against the commands, resources and leases that there are now. Real-time
//! thread; it trusts nothing that the loader has checked.

use rcc_core::message::CommandState;
use rcc_protocol::control::{Refusal, SWITCH_MAX};
use rcc_protocol::rules::{Limit, Rule, RuleFault, RuleTerm};

use super::Engine;
use crate::boards::DeviceBoards;
use crate::rule::{Judgement, TruthSet};

/// A refusal with the id of the command that it concerns; 0: none.
pub(super) type RuleRefusal = (u64, Refusal);

/// Returns true if a rule can fire now or later. One that records fires when its condition becomes true, and so never
/// again if it holds for ever.
pub(super) fn can_fire(rule: &Rule, judgement: Judgement, held: bool) -> bool {
    let stays = rule.record.is_some() && held && judgement.ever == TruthSet::TRUE;
    judgement.can_hold() && !stays
}

impl<B: DeviceBoards> Engine<B> {
    /// Checks a rule against the commands, resources and leases that there are now.
    pub(super) fn check_rule(&mut self, index: u32, rule: &Rule) -> Result<(), RuleRefusal> {
        let fault = |fault| (0, Refusal::Rule { index, fault });
        let mut targets = rule.targets().enumerate();
        match (rule.record, rule.targets().next()) {
            (None, None) => return Err(fault(RuleFault::DoesNothing)),
            (Some(_), Some(_)) => return Err(fault(RuleFault::RecordsOnly)),
            (Some(recording), None) if !recording.is_valid() => {
                return Err(fault(RuleFault::Recording));
            }
            (Some(_), None) if self.recorder.is_none() => return Err((0, Refusal::NoRecorder)),
            _ => {}
        }
        if targets.any(|(place, id)| rule.targets().take(place).any(|other| other == id)) {
            return Err(fault(RuleFault::NamedTwice));
        }
        let arms = self.check_targets(index, rule)?;
        if rule.lease != 0 && !self.leases.is_valid(rule.lease) {
            return Err(fault(RuleFault::LeaseUnknown));
        }
        if arms != 0 && rule.lease == 0 && !rule.goes_on {
            return Err(fault(RuleFault::NoLease));
        }
        for term in rule.terms() {
            self.check_term(index, term)?;
        }
        let rows = self.rows_of_terms(rule);
        let judgement = self.judge_rule(rule, &rows);
        let judgement = judgement.ok_or_else(|| fault(RuleFault::Condition))?;
        let held = rule.record.is_some_and(|recording| recording.edge);
        match can_fire(rule, judgement, held) {
            true => Ok(()),
            false => Err(fault(RuleFault::NeverFires)),
        }
    }

    fn check_term(&self, index: u32, term: &RuleTerm) -> Result<(), RuleRefusal> {
        let Some(command) = term.command() else {
            return Ok(());
        };
        let refused = |state| (command, Refusal::RuleCommand { index, state });
        let row = self.commands.find(command, |_| true);
        let row = row.map_err(|_| refused(0))?;
        let net = || {
            let net = self.commands[row].net.as_deref();
            net.ok_or_else(|| refused(self.commands[row].entry.state))
        };
        let (slot, slots) = match *term {
            RuleTerm::Value { slot, .. } => (slot, net()?.arenas().1.len()),
            RuleTerm::Compare { slot, limit, .. } => match limit {
                Limit::Real(_) => (slot, net()?.arenas().0.len()),
                Limit::Int(_) => (slot, net()?.arenas().2.len()),
            },
            _ => return Ok(()),
        };
        match (slot as usize) < slots {
            true => Ok(()),
            false => {
                let fault = RuleFault::NoSuchValue;
                Err((command, Refusal::Rule { index, fault }))
            }
        }
    }

    /// Checks states and resources of the commands that a rule acts on; returns the arms of those that it starts.
    fn check_targets(&self, index: u32, rule: &Rule) -> Result<u64, RuleRefusal> {
        let find = |id: u64, allowed: &dyn Fn(CommandState) -> bool| {
            let state = |refusal| match refusal {
                Refusal::WrongState { state } => state,
                _ => 0,
            };
            let found = self.commands.find(id, allowed);
            found.map_err(|refusal| {
                let state = state(refusal);
                (id, Refusal::RuleCommand { index, state })
            })
        };
        let loaded =
            |state: CommandState| state != CommandState::Rejected && state != CommandState::Loading;
        for id in ids(&rule.stop) {
            find(id, &loaded)?;
        }
        for id in ids(&rule.cancel) {
            let row = find(id, &loaded)?;
            let net = self.commands[row].net.as_deref();
            if !net.is_some_and(|net| net.can_cancel()) {
                return Err((id, Refusal::NotCancelable));
            }
        }
        let mut arms = 0;
        for (place, id) in ids(&rule.start).enumerate() {
            let row = find(id, &|state| state == CommandState::Ready)?;
            let claims = self.commands[row].claims();
            arms |= claims.arms;
            for other in ids(&rule.start).take(place) {
                let Ok(other) = self.commands.find(other, |_| true) else {
                    continue;
                };
                if let Some(resource) = claims.common(self.commands[other].claims()) {
                    let holder = self.commands[other].entry.id;
                    return Err((id, Refusal::Busy { holder, resource }));
                }
            }
        }
        Ok(arms)
    }
}

/// The ids in a list, without unused places.
pub(super) fn ids(list: &[u64; SWITCH_MAX]) -> impl Iterator<Item = u64> {
    list.iter().copied().filter(|id| *id != 0)
}
