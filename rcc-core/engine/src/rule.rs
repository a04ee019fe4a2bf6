//! Conditions of rules: three-valued logic over sets of values that are possible now and later. Pure functions with
//! constant bounds, used by the real-time thread, by replay, and by programs that check a rule before it is installed.

use rcc_core::message::{CommandState, EndReason};
use rcc_core::types::NULL_BOOL;
use rcc_protocol::rules::{RULE_TERMS_MAX, RuleTerm};

/// A set of the truth values false, true and null.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TruthSet(u8);

impl TruthSet {
    /// False.
    pub const FALSE: TruthSet = TruthSet(1);
    /// True.
    pub const TRUE: TruthSet = TruthSet(2);
    /// Null.
    pub const NULL: TruthSet = TruthSet(4);
    /// Any value.
    pub const ANY: TruthSet = TruthSet(7);

    /// The value of a `Bool` slot.
    #[must_use]
    pub fn of_slot(value: u8) -> TruthSet {
        match value {
            0 => TruthSet::FALSE,
            1 => TruthSet::TRUE,
            _ => TruthSet::NULL,
        }
    }

    fn of(value: bool) -> TruthSet {
        TruthSet::of_slot(u8::from(value))
    }

    /// Returns true if the set contains all of these values.
    #[must_use]
    pub fn has(self, values: TruthSet) -> bool {
        self.0 & values.0 == values.0
    }

    fn when(self, condition: bool) -> TruthSet {
        if condition { self } else { TruthSet(0) }
    }

    fn or(self, other: TruthSet) -> TruthSet {
        TruthSet(self.0 | other.0)
    }

    /// The values of `not x` for all x in the set.
    fn negated(self) -> TruthSet {
        let (no, yes) = (self.has(Self::FALSE), self.has(Self::TRUE));
        let null = TruthSet(self.0 & Self::NULL.0);
        null.or(Self::TRUE.when(no)).or(Self::FALSE.when(yes))
    }

    /// The values of `x and y` for all x and y in the sets.
    fn both(self, other: TruthSet) -> TruthSet {
        let [no, yes, null] = [Self::FALSE, Self::TRUE, Self::NULL];
        let known = |set: TruthSet| set.has(yes) || set.has(null);
        let is_null = self.has(null) && known(other) || other.has(null) && known(self);
        let is_false = self.has(no) || other.has(no);
        let is_true = self.has(yes) && other.has(yes);
        no.when(is_false)
            .or(yes.when(is_true))
            .or(null.when(is_null))
    }

    /// The values of `x or y` for all x and y in the sets.
    fn either(self, other: TruthSet) -> TruthSet {
        self.negated().both(other.negated()).negated()
    }
}

/// The values that a condition or a term has now and may have from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Judgement {
    /// The one value that it has now.
    pub now: TruthSet,
    /// All values that it may have now or later.
    pub ever: TruthSet,
}

impl Judgement {
    /// The value cannot change any more.
    #[must_use]
    pub fn fixed(value: TruthSet) -> Judgement {
        Judgement {
            now: value,
            ever: value,
        }
    }

    /// The value may become any other.
    #[must_use]
    pub fn changing(value: TruthSet) -> Judgement {
        Judgement {
            now: value,
            ever: TruthSet::ANY,
        }
    }

    /// Returns true if the condition holds.
    #[must_use]
    pub fn holds(self) -> bool {
        self.now == TruthSet::TRUE
    }

    /// Returns true if the condition can hold now or later.
    #[must_use]
    pub fn can_hold(self) -> bool {
        self.ever.has(TruthSet::TRUE)
    }
}

/// Judges a condition in postfix notation; `value` is called for every term that is not an operator, with its index.
/// Returns `None` if it is not a valid expression.
pub fn judge<'t>(
    terms: impl Iterator<Item = &'t RuleTerm>,
    mut value: impl FnMut(usize, &RuleTerm) -> Judgement,
) -> Option<Judgement> {
    let mut stack = [Judgement::fixed(TruthSet::NULL); RULE_TERMS_MAX];
    let mut depth = 0usize;
    for (index, term) in terms.take(RULE_TERMS_MAX).enumerate() {
        let (taken, result) = match term {
            RuleTerm::Not => {
                let of = *stack.get(depth.checked_sub(1)?)?;
                let (now, ever) = (of.now.negated(), of.ever.negated());
                (1, Judgement { now, ever })
            }
            RuleTerm::And | RuleTerm::Or => {
                let (a, b) = (
                    *stack.get(depth.checked_sub(2)?)?,
                    *stack.get(depth.checked_sub(1)?)?,
                );
                let join = match term {
                    RuleTerm::And => TruthSet::both,
                    _ => TruthSet::either,
                };
                let (now, ever) = (join(a.now, b.now), join(a.ever, b.ever));
                (2, Judgement { now, ever })
            }
            RuleTerm::True => (0, Judgement::fixed(TruthSet::TRUE)),
            term => (0, value(index, term)),
        };
        depth -= taken;
        *stack.get_mut(depth)? = result;
        depth += 1;
    }
    match depth {
        1 => stack.first().copied(),
        _ => None,
    }
}

/// State, reason and outcome of a command, as rules judge them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandFacts {
    /// State.
    pub state: CommandState,
    /// Reason of its end, known as soon as its net has ended, while its arm may still play the last set-points.
    pub reason: EndReason,
    /// The condition of its `Termination` that ended it, counted from 1; 0: none.
    pub outcome: u32,
}

impl CommandFacts {
    /// No such command.
    pub const MISSING: CommandFacts = CommandFacts {
        state: CommandState::None,
        reason: EndReason::None,
        outcome: 0,
    };

    /// The facts as one word.
    #[must_use]
    pub fn word(self) -> u64 {
        self.state as u64 | (self.reason as u64) << 8 | u64::from(self.outcome) << 32
    }

    /// The facts from a word.
    #[must_use]
    pub fn from_word(word: u64) -> CommandFacts {
        CommandFacts {
            state: CommandState::from_number(word as u32 & 0xff),
            reason: EndReason::from_number(word as u32 >> 8 & 0xff),
            outcome: (word >> 32) as u32,
        }
    }

    /// Returns true if nothing about the command changes any more.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(
            self.state,
            CommandState::None | CommandState::Rejected | CommandState::Terminated
        )
    }

    /// Judges a term about this command. `slot` is the value of a `Value` or `Compare` term, as the last evaluation left
    /// it.
    #[must_use]
    pub fn judge(self, term: &RuleTerm, slot: u8) -> Judgement {
        if self.state == CommandState::None {
            return Judgement::fixed(TruthSet::NULL);
        }
        let ended = self.reason != EndReason::None;
        let at_end = |value: bool| match ended {
            true => TruthSet::of(value),
            false => TruthSet::NULL,
        };
        let now = match *term {
            RuleTerm::State { state, .. } => {
                let now = TruthSet::of(self.state as u32 == state);
                // A command never returns to an earlier state.
                return match self.is_final() || state < self.state as u32 {
                    true => Judgement::fixed(now),
                    false => Judgement::changing(now),
                };
            }
            RuleTerm::Reason { reason, .. } => at_end(self.reason as u32 == reason),
            RuleTerm::Outcome { outcome, .. } => at_end(self.outcome == outcome),
            RuleTerm::Value { .. } | RuleTerm::Compare { .. } => {
                let evaluated = self.state.is_active() || ended;
                TruthSet::of_slot(if evaluated { slot } else { NULL_BOOL })
            }
            _ => TruthSet::NULL,
        };
        match self.is_final() {
            true => Judgement::fixed(now),
            false => Judgement::changing(now),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALUES: [TruthSet; 3] = [TruthSet::FALSE, TruthSet::TRUE, TruthSet::NULL];

    /// Kleene's conjunction of single values, element by element.
    fn and(a: TruthSet, b: TruthSet) -> TruthSet {
        match (a, b) {
            (TruthSet::FALSE, _) | (_, TruthSet::FALSE) => TruthSet::FALSE,
            (TruthSet::TRUE, TruthSet::TRUE) => TruthSet::TRUE,
            _ => TruthSet::NULL,
        }
    }

    fn members(set: TruthSet) -> impl Iterator<Item = TruthSet> {
        VALUES.into_iter().filter(move |value| set.has(*value))
    }

    #[test]
    fn operators_on_sets_are_those_on_all_their_members() {
        for (a, b) in (1..8).flat_map(|a| (1..8).map(move |b| (TruthSet(a), TruthSet(b)))) {
            let pairs = || members(a).flat_map(move |x| members(b).map(move |y| (x, y)));
            let conjunction = pairs().fold(TruthSet(0), |set, (x, y)| set.or(and(x, y)));
            assert_eq!(a.both(b), conjunction, "{a:?} and {b:?}");
            let not = |value: TruthSet| value.negated();
            let disjunction =
                pairs().fold(TruthSet(0), |set, (x, y)| set.or(not(and(not(x), not(y)))));
            assert_eq!(a.either(b), disjunction, "{a:?} or {b:?}");
        }
    }

    #[test]
    fn an_expression_that_is_not_valid_is_not_judged() {
        let judged = |terms: &[RuleTerm]| judge(terms.iter(), |_, _| Judgement::fixed(VALUES[2]));
        assert!(judged(&[RuleTerm::True]).is_some_and(Judgement::holds));
        let bad: [&[RuleTerm]; 5] = [
            &[],
            &[RuleTerm::Not],
            &[RuleTerm::True, RuleTerm::And],
            &[RuleTerm::True, RuleTerm::True],
            &[RuleTerm::True; RULE_TERMS_MAX],
        ];
        for terms in bad {
            assert_eq!(judged(terms), None, "{terms:?}");
        }
    }

    #[test]
    fn a_command_that_has_ended_does_not_become_anything_else() {
        let facts = |state, reason, outcome| CommandFacts {
            state,
            reason,
            outcome,
        };
        let term = |outcome| RuleTerm::Outcome {
            command: 1,
            outcome,
        };
        let over = facts(CommandState::Terminated, EndReason::Finished, 2);
        assert!(over.judge(&term(2), 2).holds());
        assert!(!over.judge(&term(1), 2).can_hold());
        let running = facts(CommandState::Running, EndReason::None, 0);
        assert_eq!(
            running.judge(&term(1), 2),
            Judgement::changing(TruthSet::NULL)
        );
        let ready = RuleTerm::State {
            command: 1,
            state: CommandState::Ready as u32,
        };
        assert!(!running.judge(&ready, 2).can_hold());
        assert_eq!(CommandFacts::from_word(over.word()), over);
        assert!(!CommandFacts::MISSING.judge(&term(1), 1).can_hold());
    }

    #[test]
    fn a_value_is_null_until_its_net_was_evaluated() {
        let value = RuleTerm::Value {
            command: 1,
            slot: 0,
        };
        let mut facts = CommandFacts {
            state: CommandState::Ready,
            ..CommandFacts::MISSING
        };
        assert_eq!(facts.judge(&value, 1).now, TruthSet::NULL);
        facts.state = CommandState::Running;
        assert!(facts.judge(&value, 1).holds());
    }
}
