//! Synchronization rules and their states. Plain data; part of the gateway's state.

use std::time::Instant;

use crate::condition::Condition;
use crate::outbox::Outbox;

/// The state of a rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RuleState {
    /// It waits for its condition.
    #[default]
    Active,
    /// It has fired.
    Fired,
    /// Its condition was true, but the core refused; nothing happened.
    FireFailed,
    /// Its condition cannot become true any more.
    Inactive,
}

impl RuleState {
    /// Returns the name of the protocol.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            RuleState::Active => "ACTIVE",
            RuleState::Fired => "FIRED",
            RuleState::FireFailed => "FIREFAILED",
            RuleState::Inactive => "INACTIVE",
        }
    }
}

/// A synchronization rule.
#[derive(Clone, Debug, Default)]
pub struct ScheduleRule {
    /// Session of its first net.
    pub session: String,
    /// When it fires.
    pub condition: Condition,
    /// Nets that it stops.
    pub stop: Vec<String>,
    /// Nets that it cancels.
    pub cancel: Vec<String>,
    /// Nets that it starts.
    pub start: Vec<String>,
    /// Its state.
    pub state: RuleState,
    /// When a client was told that it has fired.
    pub told: Option<Instant>,
    /// When the core first refused because an arm was still coming to rest, or a stop was first not delivered.
    pub trying_since: Option<Instant>,
    /// When the next attempt is due, after one in which a motion did not continue, or a stop was not delivered.
    pub not_before: Option<Instant>,
    /// Number of the core's rule that does the same in the cycle in which the condition becomes true, if there is one.
    pub core: Option<u64>,
    /// Subscriptions that have not seen its last state.
    pub subscribers: Vec<(Outbox, String)>,
}

impl ScheduleRule {
    /// Returns true if a stop of it was not delivered: it no longer waits for its condition.
    #[must_use]
    pub fn owes_stop(&self) -> bool {
        self.start.is_empty() && self.trying_since.is_some()
    }
}
