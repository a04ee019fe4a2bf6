//! Rules in a replay: their conditions are judged again on the replayed nets, and compared with what was recorded. Run
//! off-line; nothing in a recording is trusted.

use std::collections::BTreeMap;

use rcc_core::message::{CommandState, EndReason};
use rcc_core::topic::Topic;
use rcc_core::types::NULL_BOOL;
use rcc_protocol::rules::{RULES_MAX, RuleState, RuleTerm};

use super::NetReplay;
use crate::net::Evaluation;
use crate::record::rule_entry::RecordedRule;
use crate::rule::{CommandFacts, Judgement, TruthSet, judge};
use crate::rule_set::{RuleSet, contains};

/// Result of the replay of all rules.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RuleReplayResult {
    /// Conditions that were judged in the recording, over all cycles.
    pub recorded: u64,
    /// Of these, conditions that were judged again; for the others, something that they look at is not known.
    pub compared: u64,
    /// Conditions that held in the recording.
    pub held: u64,
    /// Of these, conditions that also held in the replay.
    pub reproduced: u64,
    /// Id of the rule and cycle of the first difference.
    pub mismatch: Option<(u64, u64)>,
    /// Rules that ended: cycle, id and state.
    pub ended: Vec<(u64, u64, RuleState)>,
}

struct ReplayedRule {
    id: u64,
    terms: Vec<RuleTerm>,
}

/// How the net of a command ended: its outcome, counted from 1.
#[derive(Clone, Copy)]
enum NetEnd {
    Known(u32),
    /// The evaluation that ended it was not replayed.
    Unknown,
}

/// State of rules and commands at the current cycle of the recording.
#[derive(Default)]
pub(super) struct RuleReplay {
    rules: BTreeMap<usize, ReplayedRule>,
    states: BTreeMap<u64, (CommandState, EndReason)>,
    /// Nets whose last evaluation ended them.
    ends: BTreeMap<u64, NetEnd>,
    pub(super) result: RuleReplayResult,
}

impl RuleReplay {
    /// A rule was recorded, with what it saw of its commands.
    pub(super) fn define(&mut self, recorded: RecordedRule<'_>) {
        let mut terms = Vec::new();
        for (term, facts) in recorded.terms() {
            if let Some(command) = term.command() {
                let facts = CommandFacts::from_word(facts);
                if facts.outcome != 0 {
                    self.ends.insert(command, NetEnd::Known(facts.outcome));
                }
                // The recorder gives the state of the command; that its net has ended is seen from the outcome.
                let reason = match facts.state.is_active() {
                    true => EndReason::None,
                    false => facts.reason,
                };
                self.states.insert(command, (facts.state, reason));
            }
            terms.push(term);
        }
        let id = recorded.id;
        self.rules.insert(recorded.slot, ReplayedRule { id, terms });
    }

    /// A rule has ended.
    pub(super) fn end(&mut self, cycle: u64, slot: usize, id: u64, state: RuleState) {
        self.rules.remove(&slot);
        self.result.ended.push((cycle, id, state));
    }

    /// A command has changed its state.
    pub(super) fn state(&mut self, id: u64, state: u32, reason: u32) {
        let state = CommandState::from_number(state);
        let reason = EndReason::from_number(reason);
        self.states.insert(id, (state, reason));
    }

    /// A command was unloaded, unless the request was refused because it is active.
    pub(super) fn unload(&mut self, id: u64) {
        if let Some(known) = self.states.get_mut(&id)
            && !known.0.is_active()
        {
            *known = (CommandState::None, EndReason::None);
        }
    }

    /// A net was evaluated; `outcome` is that of the replayed net, counted from 0, if it is known.
    pub(super) fn evaluated(&mut self, id: u64, evaluation: Evaluation, outcome: Option<u32>) {
        match (evaluation, outcome) {
            (Evaluation::Terminated, Some(outcome)) => {
                self.ends.insert(id, NetEnd::Known(outcome + 1));
            }
            (Evaluation::Terminated, None) => {
                self.ends.insert(id, NetEnd::Unknown);
            }
            (Evaluation::Running | Evaluation::Fault(_), _) => {
                self.ends.remove(&id);
            }
        }
    }

    /// Facts for conditions about a command; `None` if they are not known.
    fn facts(&self, id: u64) -> Option<CommandFacts> {
        let &(state, reason) = self.states.get(&id)?;
        let ended = matches!(reason, EndReason::Finished | EndReason::Canceled);
        let end = match self.ends.get(&id) {
            Some(NetEnd::Unknown) => return None,
            Some(NetEnd::Known(outcome)) => Some(*outcome),
            // The evaluation that ended it is not in the recording.
            None if ended => return None,
            None => None,
        };
        let facts = CommandFacts {
            state,
            reason,
            outcome: 0,
        };
        Some(match (end, state) {
            (Some(outcome), CommandState::Running) => CommandFacts {
                reason: EndReason::Finished,
                outcome,
                ..facts
            },
            (Some(outcome), CommandState::Canceling) => CommandFacts {
                reason: EndReason::Canceled,
                outcome,
                ..facts
            },
            (Some(outcome), CommandState::Terminated) if ended => CommandFacts { outcome, ..facts },
            _ => facts,
        })
    }

    /// Judges all rules again that were judged in this cycle.
    pub(super) fn compare(
        &mut self,
        cycle: u64,
        nets: &BTreeMap<u64, NetReplay>,
        judged: RuleSet,
        held: RuleSet,
    ) {
        for slot in (0..RULES_MAX).filter(|slot| contains(&judged, *slot)) {
            let recorded = contains(&held, slot);
            self.result.recorded += 1;
            self.result.held += u64::from(recorded);
            let Some(rule) = self.rules.get(&slot) else {
                continue;
            };
            let Some(replayed) = self.judge(rule, nets) else {
                continue;
            };
            self.result.compared += 1;
            self.result.reproduced += u64::from(replayed && recorded);
            if replayed != recorded {
                self.result.mismatch.get_or_insert((rule.id, cycle));
            }
        }
    }

    /// Returns `None` if something that the condition looks at is not known.
    fn judge(&self, rule: &ReplayedRule, nets: &BTreeMap<u64, NetReplay>) -> Option<bool> {
        let mut known = true;
        let judgement = judge(rule.terms.iter(), |_, term| {
            let judgement = self.judge_term(term, nets);
            known &= judgement.is_some();
            judgement.unwrap_or(Judgement::fixed(TruthSet::NULL))
        })?;
        known.then(|| judgement.holds())
    }

    fn judge_term(&self, term: &RuleTerm, nets: &BTreeMap<u64, NetReplay>) -> Option<Judgement> {
        if let RuleTerm::Topic { topic } = *term {
            return self.topic(topic, nets);
        }
        let id = term.command()?;
        let facts = self.facts(id)?;
        let of_value = matches!(term, RuleTerm::Value { .. } | RuleTerm::Compare { .. });
        if !of_value || facts.state == CommandState::None {
            return Some(facts.judge(term, NULL_BOOL));
        }
        let net = nets.get(&id).filter(|replay| replay.known);
        let slot = match (net.and_then(|replay| replay.net.as_ref()), facts.state) {
            (Some(net), _) => match *term {
                RuleTerm::Compare {
                    slot,
                    relation,
                    limit,
                    ..
                } => net.compared(slot, relation, limit),
                RuleTerm::Value { slot, .. } => net.bool_at(slot).unwrap_or(NULL_BOOL),
                _ => NULL_BOOL,
            },
            (None, CommandState::Ready) => NULL_BOOL,
            (None, _) => return None,
        };
        Some(facts.judge(term, slot))
    }

    /// The value of a topic: that of the one running net that publishes it.
    fn topic(&self, topic: Topic, nets: &BTreeMap<u64, NetReplay>) -> Option<Judgement> {
        let runs = |id: &u64| {
            let facts = self.facts(*id)?;
            Some(facts.state.is_active() && facts.reason == EndReason::None)
        };
        for (id, replay) in nets {
            let Some(net) = replay.net.as_ref() else {
                // It may publish the topic.
                match runs(id) {
                    Some(false) => continue,
                    _ => return None,
                }
            };
            let published = net.plan().publishes.iter();
            let Some(place) = published.clone().position(|point| point.topic == topic) else {
                continue;
            };
            match (runs(id), replay.known) {
                (Some(true), true) => {
                    let value = net.published_bool(place).unwrap_or(NULL_BOOL);
                    return Some(Judgement::changing(TruthSet::of_slot(value)));
                }
                (Some(false), _) => {}
                _ => return None,
            }
        }
        Some(Judgement::changing(TruthSet::NULL))
    }
}
