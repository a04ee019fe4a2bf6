//! Rules and leases on their way to the real-time thread: lists become of fixed size, and the texts of rules, which the
//! real-time thread does not know, are kept. Intake thread.

use rcc_ipc::request::Request;
use rcc_protocol::control::{Answer, Call, Refusal, SWITCH_MAX};
use rcc_protocol::rules::{NewRule, RULE_TEXT_MAX, RULES_PER_REQUEST, Rule, RuleStatus};

use super::{Intake, OnDone, PendingRequest, id_list, reply};
use crate::boards::EngineRequest;
use crate::rule_texts::LISTED_MAX;

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
