//! Rules and leases as plain data: what follows when a condition over running commands holds, decided by the real-time
//! thread, and for how long a client that installed rules or started commands counts as present. Read by all threads.

use rcc_core::topic::Topic;
use serde::{Deserialize, Serialize};

use crate::limits::SWITCH_MAX;
use crate::refusal::Refusal;
pub use crate::refusal::RuleFault;

/// Maximum number of rules in the executor's table, ended ones included.
pub const RULES_MAX: usize = 128;
/// Maximum number of terms and operators of a condition.
pub const RULE_TERMS_MAX: usize = 16;
/// Maximum number of rules that one request installs.
pub const RULES_PER_REQUEST: usize = 16;
/// Maximum number of rules that fire in one cycle; the others fire in the next one.
pub const RULES_PER_CYCLE: usize = 8;
/// Maximum length of the name and of the text of a rule, bytes each.
pub const RULE_TEXT_MAX: usize = 256;
/// Maximum number of leases.
pub const LEASES_MAX: usize = 64;
/// Shortest time after which a lease expires, ns.
pub const LEASE_MIN_NS: u64 = 50_000_000;
/// Longest time after which a lease expires, ns.
pub const LEASE_MAX_NS: u64 = 3_600_000_000_000;

/// Maximum number of recordings that one rule makes.
pub const RULE_RECORDINGS_MAX: u32 = 1000;
/// Shortest time between two recordings of one rule, ns.
pub const RECORD_DISTANCE_MIN_NS: u64 = 1_000_000_000;
/// Longest time between two recordings of one rule, ns.
pub const RECORD_DISTANCE_MAX_NS: u64 = 86_400_000_000_000;

/// How a value is compared with a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Relation {
    /// Less than the limit.
    Below,
    /// Less than the limit, or equal.
    AtMost,
    /// Greater than the limit.
    Above,
    /// Greater than the limit, or equal.
    AtLeast,
}

impl Relation {
    /// All relations with their signs.
    pub const ALL: [(Relation, &'static str); 4] = [
        (Relation::Below, "<"),
        (Relation::AtMost, "<="),
        (Relation::Above, ">"),
        (Relation::AtLeast, ">="),
    ];

    /// Returns its sign.
    #[must_use]
    pub fn sign(self) -> &'static str {
        let row = Self::ALL.iter().find(|row| row.0 == self);
        row.map_or("", |row| row.1)
    }

    /// Compares; neither operand is null.
    #[must_use]
    pub fn holds<T: PartialOrd>(self, value: T, limit: T) -> bool {
        match self {
            Relation::Below => value < limit,
            Relation::AtMost => value <= limit,
            Relation::Above => value > limit,
            Relation::AtLeast => value >= limit,
        }
    }
}

/// The limit that a value is compared with; its variant is the arena of the value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Limit {
    /// For a `Real`, in the unit of the port.
    Real(f64),
    /// For an `Int`.
    Int(i64),
}

/// One element of a condition in postfix notation; every condition is three-valued, and a rule fires only on true.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum RuleTerm {
    /// True.
    True,
    /// The command is in this state ([`rcc_core::message::CommandState`] as a number).
    State {
        /// Command id.
        command: u64,
        /// The state.
        state: u32,
    },
    /// The command ended for this reason ([`rcc_core::message::EndReason`] as a number); null before its end.
    Reason {
        /// Command id.
        command: u64,
        /// The reason.
        reason: u32,
    },
    /// The command ended by this condition of its `Termination`, counted from 1; null before its end.
    Outcome {
        /// Command id.
        command: u64,
        /// Number of the outcome.
        outcome: u32,
    },
    /// A `Bool` slot of the command's net, as its last evaluation left it; null before the first one.
    Value {
        /// Command id.
        command: u64,
        /// Slot in the arena of `Bool`.
        slot: u32,
    },
    /// A `Real` or `Int` slot of the command's net, as its last evaluation left it, compared with a limit; null before
    /// the first evaluation, and while the value is null.
    Compare {
        /// Command id.
        command: u64,
        /// Slot in the arena that the limit says.
        slot: u32,
        /// The comparison.
        relation: Relation,
        /// The limit that the value is compared with.
        limit: Limit,
    },
    /// A topic of type `Bool`; null while no running net publishes it.
    Topic {
        /// The topic.
        topic: Topic,
    },
    /// Negates the last operand.
    Not,
    /// Both of the last two operands.
    And,
    /// At least one of the last two operands.
    Or,
}

impl RuleTerm {
    /// Returns the id of the command that the term looks at.
    #[must_use]
    pub fn command(&self) -> Option<u64> {
        match *self {
            RuleTerm::State { command, .. }
            | RuleTerm::Reason { command, .. }
            | RuleTerm::Outcome { command, .. }
            | RuleTerm::Value { command, .. }
            | RuleTerm::Compare { command, .. } => Some(command),
            RuleTerm::True
            | RuleTerm::Topic { .. }
            | RuleTerm::Not
            | RuleTerm::And
            | RuleTerm::Or => None,
        }
    }
}

/// The recording of a rule: the last seconds of the flight recorder, each time its condition becomes true.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RuleRecording {
    /// Number of recordings after which the rule has fired, 1 to [`RULE_RECORDINGS_MAX`].
    pub times: u32,
    /// Shortest time between two recordings, ns; a condition that becomes true sooner is counted and not recorded.
    pub distance_ns: u64,
    /// The condition must have been false or null after the installation; otherwise one that is true when the rule is
    /// installed is recorded at once.
    pub edge: bool,
}

impl RuleRecording {
    /// Returns true if number and distance are within their bounds.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        (1..=RULE_RECORDINGS_MAX).contains(&self.times)
            && (RECORD_DISTANCE_MIN_NS..=RECORD_DISTANCE_MAX_NS).contains(&self.distance_ns)
    }
}

/// A rule: when the condition holds, commands are stopped and started as by a hand-over, and others are canceled, all
/// of it between the same two cycles, or nothing. A rule that records does nothing else.
///
/// Of fixed size, because the real-time thread keeps it; unused terms and ids are `None` and 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rule {
    /// The condition, in postfix notation.
    pub when: [Option<RuleTerm>; RULE_TERMS_MAX],
    /// Commands that end; those that have ended already are skipped.
    pub stop: [u64; SWITCH_MAX],
    /// Commands that are canceled; those that have ended already are skipped.
    pub cancel: [u64; SWITCH_MAX],
    /// Ready commands that start.
    pub start: [u64; SWITCH_MAX],
    /// The lease of the client that installed it; 0: none.
    pub lease: u64,
    /// The rule stays when its lease is lost, and may start an arm without a lease.
    pub goes_on: bool,
    /// It records, and does nothing else.
    pub record: Option<RuleRecording>,
}

impl Rule {
    /// A rule that always holds and does nothing.
    pub const EMPTY: Rule = Rule {
        when: [None; RULE_TERMS_MAX],
        stop: [0; SWITCH_MAX],
        cancel: [0; SWITCH_MAX],
        start: [0; SWITCH_MAX],
        lease: 0,
        goes_on: false,
        record: None,
    };

    /// Returns the terms of its condition.
    pub fn terms(&self) -> impl Iterator<Item = &RuleTerm> + Clone {
        self.when.iter().flatten()
    }

    /// Returns the ids of all commands that it acts on: those that it stops, cancels and starts.
    pub fn targets(&self) -> impl Iterator<Item = u64> {
        let lists = [self.stop, self.cancel, self.start];
        lists.into_iter().flatten().filter(|id| *id != 0)
    }

    /// Returns true if its condition or one of its lists names the command.
    #[must_use]
    pub fn names(&self, id: u64) -> bool {
        self.targets().any(|target| target == id)
            || self.terms().any(|term| term.command() == Some(id))
    }

    /// Returns true if it starts a command.
    #[must_use]
    pub fn starts(&self) -> bool {
        self.start.iter().any(|id| *id != 0)
    }
}

/// State of an installed rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RuleState {
    /// Its condition is judged in every cycle.
    Armed,
    /// Its condition held; it fires in the next cycle in which all nets that it starts are due.
    Due,
    /// It fired.
    Fired,
    /// Its condition held, but what follows was refused; nothing was stopped or started.
    Refused,
    /// It can never fire any more.
    Expired,
    /// It was disarmed, see [`DisarmReason`].
    Disarmed,
}

impl RuleState {
    /// All states with their names.
    pub const ALL: [(RuleState, &'static str); 6] = [
        (RuleState::Armed, "armed"),
        (RuleState::Due, "due"),
        (RuleState::Fired, "fired"),
        (RuleState::Refused, "refused"),
        (RuleState::Expired, "expired"),
        (RuleState::Disarmed, "disarmed"),
    ];

    /// Returns its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        let row = Self::ALL.iter().find(|row| row.0 == self);
        row.map_or("", |row| row.1)
    }

    /// Returns true if the rule may still fire.
    #[must_use]
    pub fn is_pending(self) -> bool {
        matches!(self, RuleState::Armed | RuleState::Due)
    }
}

/// Why a rule was disarmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DisarmReason {
    /// A client removed it.
    Removed,
    /// A client stopped this command, and the rule would have started a motion after it.
    Stopped {
        /// Command id.
        command: u64,
    },
    /// The lease of the client that installed it expired or was ended.
    ClientLost {
        /// The lease.
        lease: u64,
    },
    /// The executor is stopping.
    Stopping,
}

/// An installed rule, as the executor reports it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RuleStatus {
    /// Number of the rule, never used again in this incarnation of the executor.
    pub id: u64,
    /// Its state.
    pub state: RuleState,
    /// Executor cycle in which it was installed, or reached a state in which it cannot fire any more.
    pub cycle: u64,
    /// Why it was refused or expired, and the command concerned (0: none).
    pub refusal: Option<(u64, Refusal)>,
    /// Why it was disarmed.
    pub disarmed: Option<DisarmReason>,
    /// The lease of the client that installed it; 0: none.
    pub lease: u64,
    /// It stays when its lease is lost.
    pub goes_on: bool,
    /// Recordings that it has made.
    pub recordings: u32,
    /// How often its condition became true too soon after its last recording.
    pub skipped: u32,
    /// Executor cycle of its last recording; 0: none.
    pub recorded_cycle: u64,
}

impl RuleStatus {
    /// No rule.
    pub const NONE: RuleStatus = RuleStatus {
        id: 0,
        state: RuleState::Expired,
        cycle: 0,
        refusal: None,
        disarmed: None,
        lease: 0,
        goes_on: false,
        recordings: 0,
        skipped: 0,
        recorded_cycle: 0,
    };
}

/// An installed rule with its texts, as the executor's intake thread lists it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ListedRule {
    /// The rule as installed.
    pub rule: Rule,
    /// Its state.
    pub status: RuleStatus,
    /// Name given by the client.
    pub name: String,
    /// Its condition as text.
    pub when: String,
}

/// A rule to be installed, with texts that the executor keeps for listings only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NewRule {
    /// The rule.
    pub rule: Rule,
    /// Name given by the client, at most [`RULE_TEXT_MAX`] bytes.
    pub name: String,
    /// Its condition as text, at most [`RULE_TEXT_MAX`] bytes.
    pub when: String,
}
