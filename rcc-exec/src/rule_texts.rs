//! Names and conditions of rules, which the real-time thread does not know. Written by the intake thread for listings,
//! read by the writer of incident files.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rcc_protocol::rules::{ListedRule, Rule, RuleStatus};

/// Maximum number of rules in one answer: with the longest texts they fit into it.
pub(crate) const LISTED_MAX: usize = 8;
/// Maximum number of texts that are kept; those of the oldest rules are dropped first.
const TEXTS_MAX: usize = 1024;

/// Names and conditions of rules by their ids; copies share them.
#[derive(Clone, Debug, Default)]
pub struct RuleTexts(Arc<Mutex<BTreeMap<u64, [String; 2]>>>);

impl RuleTexts {
    fn texts(&self) -> MutexGuard<'_, BTreeMap<u64, [String; 2]>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Remembers the texts of rules with consecutive ids.
    pub(crate) fn add(&self, first: u64, texts: Vec<[String; 2]>) {
        let mut all = self.texts();
        all.extend((first..).zip(texts));
        while all.len() > TEXTS_MAX {
            all.pop_first();
        }
    }

    pub(crate) fn remove(&self, id: u64) {
        self.texts().remove(&id);
    }

    /// The condition of a rule, unless it was removed.
    pub(crate) fn condition(&self, id: u64) -> Option<String> {
        let texts = self.texts();
        texts.get(&id).map(|[_, when]| when.clone())
    }

    /// Adds the texts to a list of rules.
    pub(crate) fn listed(&self, list: Vec<(Rule, RuleStatus)>) -> Vec<ListedRule> {
        let texts = self.texts();
        let with_texts = |(rule, status): (Rule, RuleStatus)| {
            let [name, when] = texts.get(&status.id).cloned().unwrap_or_default();
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

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_protocol::control::Answer;
    use rcc_protocol::control::RESPONSE_MAX;
    use rcc_protocol::control::{Refusal, SWITCH_MAX};
    use rcc_protocol::rules::RULE_TEXT_MAX;
    use rcc_protocol::rules::{Limit, Relation, RuleRecording, RuleTerm};
    use rcc_protocol::wire;

    #[test]
    fn the_longest_list_fits_into_an_answer() {
        let term = RuleTerm::Compare {
            command: u64::MAX,
            slot: u32::MAX,
            relation: Relation::AtLeast,
            limit: Limit::Int(i64::MAX),
        };
        let rule = Rule {
            when: [Some(term); 16],
            stop: [u64::MAX; SWITCH_MAX],
            cancel: [u64::MAX; SWITCH_MAX],
            start: [u64::MAX; SWITCH_MAX],
            lease: u64::MAX,
            goes_on: true,
            record: Some(RuleRecording {
                times: u32::MAX,
                distance_ns: u64::MAX,
                edge: true,
            }),
        };
        let status = RuleStatus {
            id: 7,
            cycle: u64::MAX,
            lease: u64::MAX,
            refusal: Some((u64::MAX, Refusal::NotCancelable)),
            recordings: u32::MAX,
            skipped: u32::MAX,
            recorded_cycle: u64::MAX,
            ..RuleStatus::NONE
        };
        let texts = RuleTexts::default();
        let long = "x".repeat(RULE_TEXT_MAX);
        texts.add(7, vec![[long.clone(), long]]);
        let listed = texts.listed(vec![(rule, status); LISTED_MAX]);
        assert_eq!(listed[0].name.len(), RULE_TEXT_MAX);
        let bytes = wire::encode(&Answer::Rules(listed)).expect("it fits");
        assert!(bytes.len() < RESPONSE_MAX, "{}", bytes.len());
    }

    #[test]
    fn texts_are_bounded() {
        let texts = RuleTexts::default();
        for first in 0..3000 {
            texts.add(first, vec![Default::default()]);
        }
        assert_eq!(texts.texts().len(), TEXTS_MAX);
        assert_eq!(texts.condition(2999).as_deref(), Some(""));
        assert_eq!(texts.condition(1), None);
    }
}
