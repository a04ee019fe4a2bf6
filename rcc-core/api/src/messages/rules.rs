//! Messages about rules and leases. Pure.

use rcc_core::message::CommandState;
use rcc_protocol::rules::{DisarmReason, RuleFault, RuleState, RuleStatus};

use super::NameResolver;
use crate::codes::{self, ErrorCode};
use crate::error::ApiError;

/// Why a rule or lease is refused: code, message, help. `rule` names it for people, `net` the command concerned.
pub(super) fn fault(rule: &str, net: &str, fault: RuleFault) -> (ErrorCode, String, String) {
    let (code, message, help) = match fault {
        RuleFault::TableFull { max } => (
            codes::RULE_REFUSED,
            format!("the table of rules is full: {max} rules can still fire"),
            "remove some: `rcc-cli rules ls`, then `rcc-cli rules remove NUMBER`",
        ),
        RuleFault::Condition => (
            codes::BAD_CONDITION,
            format!("{rule}: its condition is empty or has more than 16 terms and operators"),
            "split it into several rules, or let a net compute a part of it as a Bool output",
        ),
        RuleFault::NoSuchValue => (
            codes::BAD_CONDITION,
            format!("{rule}: {net} has no such value"),
            "the file with the net's names is damaged: load the net again",
        ),
        RuleFault::DoesNothing => (
            codes::RULE_REFUSED,
            format!("{rule} does nothing"),
            "give it `stop`, `cancel`, `start` or `record`",
        ),
        RuleFault::NamedTwice => (
            codes::RULE_REFUSED,
            format!("{rule} names a command twice"),
            "name each command only once, to stop it, to cancel it or to start it",
        ),
        RuleFault::NeverFires => (
            codes::RULE_REFUSED,
            format!("{rule} can never fire: its condition cannot become true any more"),
            "compare it with the states and outcomes that the commands have now: `rcc-cli ls`",
        ),
        RuleFault::NoLease => (
            codes::RULE_REFUSED,
            format!("{rule} starts an arm, but does not say what happens when its client is gone"),
            "give it a lease (`POST /leases`, `rcc-cli rules install --stay`), or write `on_client_loss: go on`",
        ),
        RuleFault::LeaseUnknown => (
            codes::UNKNOWN_LEASE,
            "the lease does not exist, has expired or was ended".to_owned(),
            "ask for a new one: `POST /leases`, and renew it in time",
        ),
        RuleFault::Recording => (
            codes::RULE_REFUSED,
            format!("{rule}: `record` is out of range"),
            "`times` is 1 to 1000, `distance_ms` is 1000 to 86 400 000",
        ),
        RuleFault::RecordsOnly => (
            codes::RULE_REFUSED,
            format!("{rule} records, and also stops, cancels or starts commands"),
            "write two rules with the same condition: a rule that acts fires once, one that records may fire again",
        ),
    };
    (code, message, help.to_owned())
}

/// A command of a rule is in a state that does not suit it.
pub(super) fn command(rule: &str, net: &str, state: u32) -> (ErrorCode, String, String) {
    match CommandState::from_number(state) {
        CommandState::None => (
            codes::UNKNOWN_COMMAND,
            format!("{rule}: {net} does not exist"),
            "load it first; `rcc-cli ls` lists all".to_owned(),
        ),
        state => (
            codes::WRONG_STATE,
            format!("{rule}: {net} is {}", state.name()),
            "a rule starts commands that are ready, and stops or cancels commands that are loaded"
                .to_owned(),
        ),
    }
}

impl NameResolver<'_> {
    /// Returns code and words of why nothing followed a rule; `None` if it fired or may still fire.
    #[must_use]
    pub fn rule_end(&self, status: &RuleStatus) -> Option<(Option<String>, String)> {
        if let Some(reason) = status.disarmed {
            return Some((None, self.disarmed(reason)));
        }
        let (id, refusal) = status.refusal?;
        if status.state == RuleState::Expired && id == 0 {
            let words = "its condition can never hold any more";
            return Some((None, words.to_owned()));
        }
        let ApiError { code, message, .. } = self.refusal(id, refusal);
        let words = match status.state {
            RuleState::Expired => format!("it starts {message}"),
            _ => message,
        };
        Some((Some(code.code.to_owned()), words))
    }

    fn disarmed(&self, reason: DisarmReason) -> String {
        match reason {
            DisarmReason::Removed => "it was removed".to_owned(),
            DisarmReason::Stopped { command } => format!(
                "a client stopped {}, and the rule would start something after it",
                (self.net)(command)
            ),
            DisarmReason::ClientLost { lease } => {
                format!("its client is gone: lease {lease} expired or was ended")
            }
            DisarmReason::Stopping => "the executor is stopping".to_owned(),
        }
    }
}
