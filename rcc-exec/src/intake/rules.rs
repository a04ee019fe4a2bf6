//! Rules and leases on their way to the real-time thread: lists become of fixed size, and the texts of rules, which the
//! real-time thread does not know, are kept for listings. Intake thread.

use std::collections::BTreeMap;

use rcc_ipc::request::Request;
use rcc_protocol::control::{Answer, Call, Refusal, SWITCH_MAX};
use rcc_protocol::rules::{
    ListedRule, NewRule, RULE_TEXT_MAX, RULES_PER_REQUEST, Rule, RuleStatus,
};

use super::{Intake, OnDone, PendingRequest, id_list, reply};
use crate::boards::EngineRequest;

/// Maximum number of rules in one answer: with the longest texts they fit into it.
const LISTED_MAX: usize = 8;
/// Maximum number of texts that are kept; those of the oldest rules are dropped first.
const TEXTS_MAX: usize = 1024;

/// Names and conditions of rules by their ids.
#[derive(Debug, Default)]
pub(super) struct RuleTexts {
    texts: BTreeMap<u64, [String; 2]>,
}

impl RuleTexts {
    /// Remembers the texts of rules with consecutive ids.
    pub(super) fn add(&mut self, first: u64, texts: Vec<[String; 2]>) {
        self.texts.extend((first..).zip(texts));
        while self.texts.len() > TEXTS_MAX {
            self.texts.pop_first();
        }
    }

    pub(super) fn remove(&mut self, id: u64) {
        self.texts.remove(&id);
    }

    /// Adds the texts to a list of rules.
    pub(super) fn listed(&self, list: Vec<(Rule, RuleStatus)>) -> Vec<ListedRule> {
        let with_texts = |(rule, status): (Rule, RuleStatus)| {
            let [name, when] = self.texts.get(&status.id).cloned().unwrap_or_default();
            ListedRule {
                rule,
                status,
                name,
                when,
            }
        };
        list.into_iter().map(with_texts).collect()
    }
}

impl Intake {
    /// Passes a call about rules or leases on.
    pub(super) fn dispatch_rules(&mut self, ticket: u64, call: Call, request: Request) {
        let mut on_done = OnDone::Nothing;
        let engine_request = match call {
            Call::InstallRules { rules } => {
                let long = |text: &String| text.len() > RULE_TEXT_MAX;
                let too_long = |rule: &NewRule| long(&rule.name) || long(&rule.when);
                if rules.len() > RULES_PER_REQUEST || rules.iter().any(too_long) {
                    return reply(request, &Answer::Refused(Refusal::NotUnderstood));
                }
                let texts = rules
                    .iter()
                    .map(|rule| [rule.name.clone(), rule.when.clone()]);
                on_done = OnDone::RulesInstalled(texts.collect());
                let rules = rules.into_iter().map(|rule| rule.rule).collect();
                EngineRequest::InstallRules { ticket, rules }
            }
            Call::RemoveRule { id } => {
                on_done = OnDone::RuleRemoved(id);
                EngineRequest::RemoveRule { ticket, id }
            }
            Call::Rules { after } => {
                let list = Vec::with_capacity(LISTED_MAX);
                EngineRequest::ListRules {
                    ticket,
                    after,
                    list,
                }
            }
            Call::GrantLease { expires_ns } => EngineRequest::GrantLease { ticket, expires_ns },
            Call::RenewLease { lease } => EngineRequest::RenewLease { ticket, lease },
            Call::EndLease { lease } => EngineRequest::EndLease { ticket, lease },
            Call::BindLease { lease, commands } => match id_list(&commands) {
                Some(commands) => EngineRequest::BindLease {
                    ticket,
                    lease,
                    commands,
                },
                None => {
                    let max = SWITCH_MAX as u32;
                    return reply(request, &Answer::Refused(Refusal::SwitchTooLarge { max }));
                }
            },
            _ => return reply(request, &Answer::Refused(Refusal::NotUnderstood)),
        };
        let pending = PendingRequest { request, on_done };
        self.submit(engine_request, Some((ticket, pending)));
    }

    /// Answers with the rules that the real-time thread listed.
    pub(super) fn handle_rules(&mut self, ticket: u64, list: Vec<(Rule, RuleStatus)>) {
        if let Some(PendingRequest { request, .. }) = self.pending.remove(&ticket) {
            let listed = self.rule_texts.listed(list);
            reply(request, &Answer::Rules(listed));
        }
    }

    /// Keeps or forgets texts when the real-time thread has confirmed a request.
    pub(super) fn note_rules(&mut self, answer: &Answer, on_done: &mut OnDone) {
        match (answer, on_done) {
            (Answer::RulesInstalled { first, .. }, OnDone::RulesInstalled(texts)) => {
                self.rule_texts.add(*first, std::mem::take(texts));
            }
            (Answer::Done { .. }, OnDone::RuleRemoved(id)) => self.rule_texts.remove(*id),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_protocol::control::RESPONSE_MAX;
    use rcc_protocol::rules::RuleTerm;
    use rcc_protocol::wire;

    #[test]
    fn the_longest_list_fits_into_an_answer() {
        let topic = rcc_core::topic::Topic {
            key: u64::MAX,
            kind: u64::MAX,
        };
        let rule = Rule {
            when: [Some(RuleTerm::Topic { topic }); 16],
            stop: [u64::MAX; SWITCH_MAX],
            cancel: [u64::MAX; SWITCH_MAX],
            start: [u64::MAX; SWITCH_MAX],
            lease: u64::MAX,
            goes_on: true,
        };
        let status = RuleStatus {
            id: 7,
            cycle: u64::MAX,
            lease: u64::MAX,
            refusal: Some((u64::MAX, Refusal::NotCancelable)),
            ..RuleStatus::NONE
        };
        let mut texts = RuleTexts::default();
        let long = "x".repeat(RULE_TEXT_MAX);
        texts.add(7, vec![[long.clone(), long]]);
        let listed = texts.listed(vec![(rule, status); LISTED_MAX]);
        assert_eq!(listed[0].name.len(), RULE_TEXT_MAX);
        let bytes = wire::encode(&Answer::Rules(listed)).expect("it fits");
        assert!(bytes.len() < RESPONSE_MAX, "{}", bytes.len());
    }

    #[test]
    fn texts_are_bounded() {
        let mut texts = RuleTexts::default();
        for first in 0..3000 {
            texts.add(first, vec![Default::default()]);
        }
        assert_eq!(texts.texts.len(), TEXTS_MAX);
    }
}
