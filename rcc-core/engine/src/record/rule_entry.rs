//! Rules in the words of the flight recorder: a condition with what it saw of its commands when it was recorded. Written
//! by the real-time thread, read by replay.

use rcc_core::topic::Topic;
use rcc_protocol::rules::{Limit, RULE_TERMS_MAX, Relation, Rule, RuleTerm};

/// Words of one term: kind and number, command or key, kind of the topic or the limit, facts about the command.
pub const TERM_WORDS: usize = 4;

/// Kind of the first comparison with a `Real`; those with the other relations follow.
const COMPARE_REAL: u32 = 10;
/// Kind of the first comparison with an `Int`.
const COMPARE_INT: u32 = COMPARE_REAL + Relation::ALL.len() as u32;

/// A condition as recorded.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRule<'a> {
    /// Row of the table of rules.
    pub slot: usize,
    /// Id of the rule.
    pub id: u64,
    words: &'a [u64],
}

/// The words of a term, without its facts.
fn encode(term: &RuleTerm) -> [u64; 3] {
    let (kind, number, one, two): (u32, u32, u64, u64) = match *term {
        RuleTerm::True => (1, 0, 0, 0),
        RuleTerm::State { command, state } => (2, state, command, 0),
        RuleTerm::Reason { command, reason } => (3, reason, command, 0),
        RuleTerm::Outcome { command, outcome } => (4, outcome, command, 0),
        RuleTerm::Value { command, slot } => (5, slot, command, 0),
        RuleTerm::Topic { topic } => (6, 0, topic.key, topic.kind),
        RuleTerm::Not => (7, 0, 0, 0),
        RuleTerm::And => (8, 0, 0, 0),
        RuleTerm::Or => (9, 0, 0, 0),
        RuleTerm::Compare {
            command,
            slot,
            relation,
            limit,
        } => {
            let (first, bits) = match limit {
                Limit::Real(limit) => (COMPARE_REAL, limit.to_bits()),
                Limit::Int(limit) => (COMPARE_INT, limit.cast_unsigned()),
            };
            (first + relation as u32, slot, command, bits)
        }
    };
    [u64::from(kind) | u64::from(number) << 32, one, two]
}

fn decode(words: &[u64; TERM_WORDS]) -> Option<RuleTerm> {
    let [head, command, two, _] = *words;
    let number = (head >> 32) as u32;
    Some(match head as u32 {
        1 => RuleTerm::True,
        2 => RuleTerm::State {
            command,
            state: number,
        },
        3 => RuleTerm::Reason {
            command,
            reason: number,
        },
        4 => RuleTerm::Outcome {
            command,
            outcome: number,
        },
        5 => RuleTerm::Value {
            command,
            slot: number,
        },
        6 => RuleTerm::Topic {
            topic: Topic {
                key: command,
                kind: two,
            },
        },
        7 => RuleTerm::Not,
        8 => RuleTerm::And,
        9 => RuleTerm::Or,
        kind @ COMPARE_REAL.. => {
            let (first, limit) = match kind {
                COMPARE_INT.. => (COMPARE_INT, Limit::Int(two.cast_signed())),
                _ => (COMPARE_REAL, Limit::Real(f64::from_bits(two))),
            };
            let &(relation, _) = Relation::ALL.get(kind.checked_sub(first)? as usize)?;
            RuleTerm::Compare {
                command,
                slot: number,
                relation,
                limit,
            }
        }
        _ => return None,
    })
}

/// Calls `push` with the words of each term of a rule; `facts` are those about their commands.
pub(super) fn push_terms(
    rule: &Rule,
    facts: &[u64; RULE_TERMS_MAX],
    mut push: impl FnMut([u64; TERM_WORDS]),
) {
    for (term, facts) in rule.terms().zip(facts) {
        let [head, one, two] = encode(term);
        push([head, one, two, *facts]);
    }
}

/// Reads a recorded rule; `None` if the words are not one.
pub(super) fn read(slot: u8, words: &[u64]) -> Option<RecordedRule<'_>> {
    let &[id, ref words @ ..] = words else {
        return None;
    };
    let whole = words.len().is_multiple_of(TERM_WORDS);
    let fits = whole && words.len() <= RULE_TERMS_MAX * TERM_WORDS;
    let recorded = RecordedRule {
        slot: usize::from(slot),
        id,
        words,
    };
    let terms = words.chunks_exact(TERM_WORDS);
    let known = recorded.terms().count() == terms.count();
    (fits && known).then_some(recorded)
}

impl<'a> RecordedRule<'a> {
    /// Its terms, with the facts about their commands as a word.
    pub fn terms(&self) -> impl Iterator<Item = (RuleTerm, u64)> + use<'a> {
        let terms = self.words.chunks_exact(TERM_WORDS);
        terms.filter_map(|words| {
            let words: &[u64; TERM_WORDS] = words.try_into().ok()?;
            Some((decode(words)?, words[TERM_WORDS - 1]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_term_is_read_as_it_was_written() {
        let (command, topic) = (7, Topic { key: 8, kind: 9 });
        let compare = |relation, limit| RuleTerm::Compare {
            command,
            slot: 4,
            relation,
            limit,
        };
        let terms = [
            RuleTerm::True,
            RuleTerm::State { command, state: 4 },
            RuleTerm::Reason { command, reason: 1 },
            RuleTerm::Outcome {
                command,
                outcome: 2,
            },
            RuleTerm::Value {
                command,
                slot: u32::MAX,
            },
            RuleTerm::Topic { topic },
            RuleTerm::Not,
            RuleTerm::And,
            RuleTerm::Or,
            compare(Relation::Below, Limit::Real(-1.5)),
            compare(Relation::AtLeast, Limit::Real(0.0)),
            compare(Relation::AtMost, Limit::Int(i64::MAX)),
            compare(Relation::Above, Limit::Int(-3)),
        ];
        let mut rule = Rule::EMPTY;
        for (place, term) in rule.when.iter_mut().zip(terms) {
            *place = Some(term);
        }
        let facts = std::array::from_fn(|index| index as u64);
        let mut words = vec![5];
        push_terms(&rule, &facts, |term| words.extend(term));
        let recorded = read(3, &words).expect("a rule");
        assert_eq!((recorded.slot, recorded.id), (3, 5));
        let expected: Vec<(RuleTerm, u64)> = terms.into_iter().zip(facts).collect();
        assert_eq!(recorded.terms().collect::<Vec<_>>(), expected);
        assert!(read(3, &words[..words.len() - 1]).is_none());
        words[1] = 99;
        assert!(read(3, &words).is_none());
    }
}
