//! Bodies of requests and answers about rules and leases. Plain data.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

use super::CommandRef;

/// Commands: one, or a list of at most 8.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(untagged)]
pub enum CommandList {
    /// One command.
    One(CommandRef),
    /// Several commands.
    Several(Vec<CommandRef>),
}

impl Default for CommandList {
    fn default() -> CommandList {
        CommandList::Several(Vec::new())
    }
}

impl CommandList {
    /// Returns the commands.
    #[must_use]
    pub fn commands(&self) -> &[CommandRef] {
        match self {
            CommandList::One(command) => std::slice::from_ref(command),
            CommandList::Several(commands) => commands,
        }
    }

    fn is_empty(&self) -> bool {
        self.commands().is_empty()
    }
}

/// Effect of the loss of a client on its rules and commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub enum OnClientLoss {
    /// The rule is disarmed; the command, or what the rule started, is canceled.
    #[default]
    #[serde(rename = "cancel")]
    Cancel,
    /// The rule stays armed, and the command goes on.
    #[serde(rename = "go on")]
    GoOn,
}

/// When a rule that records writes an incident.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RecordBody {
    /// Number of recordings after which the rule has fired, 1 to 1000.
    #[serde(default = "once")]
    pub times: u32,
    /// Shortest time between two recordings, ms; 1000 to 86 400 000. A condition that becomes true sooner is counted
    /// and not recorded.
    #[serde(default = "ten_seconds")]
    pub distance_ms: u64,
    /// Do not record a condition that is true already when the rule is installed.
    #[serde(default)]
    pub edge: bool,
}

impl Default for RecordBody {
    fn default() -> RecordBody {
        RecordBody {
            times: once(),
            distance_ms: ten_seconds(),
            edge: false,
        }
    }
}

fn once() -> u32 {
    1
}

fn ten_seconds() -> u64 {
    10_000
}

/// What a rule has recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct RecordedView {
    /// Recordings so far.
    pub recordings: u32,
    /// How often its condition became true sooner than `distance_ms` after the last recording.
    pub skipped: u32,
    /// Executor cycle of the last recording.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cycle: Option<u64>,
}

/// A rule: when the condition holds, commands stop, are canceled and start between the same two cycles, or nothing
/// changes. A rule that records does nothing else.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RuleBody {
    /// Name for people; without it, the condition.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The condition, such as `approach.outcome == touched and not topic(part/there)`.
    pub when: String,
    /// Commands that end; those that have ended already are skipped.
    #[serde(default, skip_serializing_if = "CommandList::is_empty")]
    pub stop: CommandList,
    /// Commands that are canceled; those that have ended already are skipped.
    #[serde(default, skip_serializing_if = "CommandList::is_empty")]
    pub cancel: CommandList,
    /// Ready commands that start.
    #[serde(default, skip_serializing_if = "CommandList::is_empty")]
    pub start: CommandList,
    /// Each time the condition becomes true, the last seconds of the flight recorder are written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<RecordBody>,
    /// The client's lease; without it, that of the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<u64>,
    /// Behaviour when the client is gone.
    #[serde(default)]
    pub on_client_loss: OnClientLoss,
}

/// Rules to be installed: all of them between the same two cycles, or none.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RulesBody {
    /// At most 16 rules.
    pub rules: Vec<RuleBody>,
    /// The client's lease, for rules that name none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<u64>,
}

/// A rule that was installed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct RuleNumber {
    /// Its number.
    pub rule: u64,
    /// Its name.
    pub name: String,
}

/// Answer to an installation.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct RulesInstalled {
    /// Executor cycle from which on the conditions are judged.
    pub cycle: u64,
    /// The rules, in the order of the request.
    pub rules: Vec<RuleNumber>,
}

/// A rule and its state.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct RuleView {
    /// Its number.
    pub rule: u64,
    /// Its name.
    pub name: String,
    /// Its condition.
    pub when: String,
    /// Commands that it stops, as `net#id`.
    pub stop: Vec<String>,
    /// Commands that it cancels.
    pub cancel: Vec<String>,
    /// Commands that it starts.
    pub start: Vec<String>,
    /// When it records, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<RecordBody>,
    /// What it has recorded, if it records.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<RecordedView>,
    /// `armed due fired refused expired disarmed`.
    pub state: String,
    /// Executor cycle in which it was installed, or in which it fired or ended otherwise.
    pub cycle: u64,
    /// The client's lease.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<u64>,
    /// Behaviour when the client is gone.
    pub on_client_loss: OnClientLoss,
    /// Code of the reason why nothing followed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// Why nothing followed; absent if it fired or still may.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub words: Option<String>,
}

/// Request for a lease.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct LeaseBody {
    /// Time after which it expires unless it is renewed, ms; 50 to 3 600 000.
    pub expires_ms: u64,
}

/// A granted lease.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct LeaseGranted {
    /// Its number.
    pub lease: u64,
    /// Time after which it expires unless it is renewed, ms.
    pub expires_ms: u64,
}

/// A lease was renewed, ended, or commands were bound to it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct LeaseDone {
    /// Its number.
    pub lease: u64,
    /// Executor cycle in which it took effect.
    pub cycle: u64,
}

/// Commands to be bound to a lease.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct LeaseCommands {
    /// At most 8 ready or active commands.
    pub commands: CommandList,
}
