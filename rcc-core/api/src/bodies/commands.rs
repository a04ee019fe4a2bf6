//! Bodies of LOAD, START, CANCEL and hand-over, and what a command is and how it ended.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

use super::{CommandRef, Finding, RuleBody, is_active};

/// Answer to LOAD.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Loaded {
    /// The command's id.
    pub id: u64,
    /// `loading`; with `wait_ms` also `ready` or `rejected`.
    pub state: String,
}

/// Answer to a check: what LOAD, or a restart of the cell, would say of a text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Checked {
    /// `net`, or `cell` for the configuration of a cell.
    pub kind: String,
    /// The net's name, as far as it can be found; empty for the configuration of a cell.
    pub name: String,
    /// False if the text has errors.
    pub valid: bool,
    /// Errors and warnings.
    pub diagnostics: Vec<Finding>,
    /// Resources that the net would claim exclusively, and topics that it would publish.
    pub uses: Vec<String>,
}

/// Answer to START, CANCEL, ABORT and UNLOAD.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Done {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Executor cycle in which it took effect; 0 if none was involved.
    pub cycle: u64,
}

/// Options of START.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Commands that end between the same two cycles; if the net cannot take over from them, nothing changes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub after_stopping: Vec<CommandRef>,
    /// Rules that are installed first; if START is refused, they are removed again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rules: Vec<RuleBody>,
    /// The client's lease: the command is bound to it, and so are rules that name none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<u64>,
}

/// A hand-over: all of it happens between the same two cycles, or nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// Active commands that end, at most 8.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stop: Vec<CommandRef>,
    /// Ready commands that start, at most 8.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub start: Vec<CommandRef>,
    /// Rules that are installed first; if the hand-over is refused, they are removed again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rules: Vec<RuleBody>,
    /// The client's lease: the commands that start are bound to it, and so are rules that name none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<u64>,
}

/// Answer to a hand-over.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Switched {
    /// Executor cycle in which the started commands were first evaluated; the stopped ones were last evaluated in the
    /// cycle before.
    pub cycle: u64,
    /// The stopped commands, in the order of the request.
    pub stopped: Vec<Done>,
    /// The started commands, in the order of the request.
    pub started: Vec<Done>,
}

/// A command.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct CommandView {
    /// Its id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// The net's description.
    #[serde(default)]
    pub description: String,
    /// `loading rejected ready running canceling terminated`.
    pub state: String,
    /// Reason of a terminated command: `finished canceled aborted fault`.
    #[serde(default)]
    pub reason: Option<String>,
    /// Name of the outcome of its `Termination` that ended a finished or canceled command; `null` if it has no name.
    #[serde(default)]
    pub outcome: Option<String>,
    /// How a terminated command ended, in words: `finished: arrived`, or the fault.
    #[serde(default)]
    pub words: Option<String>,
    /// Details of a fault.
    #[serde(default)]
    pub fault: Option<FaultView>,
    /// True if the net has a `Cancel` primitive.
    pub can_cancel: bool,
    /// Cycles evaluated since START.
    pub cycles: u64,
    /// Executor cycle of the first evaluation; 0 if there was none.
    pub started_cycle: u64,
    /// Executor cycle of the last evaluation; 0 if there was none.
    pub ended_cycle: u64,
    /// Duration of the last evaluation, ns.
    pub exec_last_ns: u64,
    /// Longest evaluation, ns.
    pub exec_max_ns: u64,
    /// Mean duration of all evaluations, ns.
    #[serde(default)]
    pub exec_mean_ns: u64,
    /// Expected duration of one evaluation on this machine, ns; 0 if not known.
    #[serde(default)]
    pub expected_ns: u64,
    /// Number of primitives.
    #[serde(default)]
    pub primitives: u32,
    /// Unique resources, as shown to people: `lwr`, `lwr.torch`.
    #[serde(default)]
    pub uses: Vec<String>,
    /// Time of loading, seconds since the Unix epoch.
    #[serde(default)]
    pub loaded_at: u64,
    /// Result of the rehearsal in virtual time, for a net that commands an arm.
    #[serde(default)]
    pub rehearsal: Option<RehearsalView>,
    /// Errors and warnings of its text.
    #[serde(default)]
    pub diagnostics: Vec<Finding>,
}

/// Result of a rehearsal: what a net did in virtual time, before anything was commanded.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct RehearsalView {
    /// Virtual time that was checked, s.
    pub time_s: f64,
    /// `finished`: checked to the net's end; `waits`: checked until nothing moved any more; `too long`: the net
    /// continues after the checked time; `elsewhere`: nothing was checked, START does it.
    pub end: String,
    /// Name of the outcome with which the net finished; `null` if it did not, or if its outcomes have no names.
    #[serde(default)]
    pub outcome: Option<String>,
    /// Smallest distance to a singularity; `null` if not known.
    #[serde(default)]
    pub singularity: Option<f64>,
    /// Highest use of the limits of velocity, acceleration and jerk; empty if nothing moved.
    #[serde(default)]
    pub peaks: Vec<PeakView>,
    /// Summary for people.
    pub words: String,
    /// Duration of the rehearsal, ns.
    pub took_ns: u64,
}

/// The highest use of a limit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PeakView {
    /// `speed`, `acceleration` or `jerk`.
    pub of: String,
    /// The device.
    pub device: String,
    /// The joint.
    pub joint: String,
    /// Fraction of the limit; 1 is the limit itself.
    pub share: f64,
}

/// A command with its text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct CommandDetail {
    /// The command.
    #[serde(flatten)]
    pub command: CommandView,
    /// The text that was loaded.
    pub text: String,
    /// Slots of every port and monitor in the plan; `null` while it is loading, and in brief answers.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub names: serde_json::Value,
}

/// Id of a command and the time at which it was loaded: ids begin again with another executor.
pub type CommandKey = (u64, u64);

impl CommandView {
    /// Returns true while the command is `running` or `canceling`.
    #[must_use]
    pub fn is_active(&self) -> bool {
        is_active(&self.state)
    }

    /// Returns the newest command of each net that is ready or active.
    #[must_use]
    pub fn newest_of_each_net(commands: &[CommandView]) -> BTreeMap<&str, CommandKey> {
        let mut newest: BTreeMap<&str, CommandKey> = BTreeMap::new();
        let loaded = |row: &&CommandView| row.is_active() || row.state == "ready";
        for row in commands.iter().filter(loaded) {
            let of_net = newest.entry(&row.net).or_default();
            *of_net = (*of_net).max((row.id, row.loaded_at));
        }
        newest
    }
}

impl CommandDetail {
    /// Returns the primitives of the inputs that a client may set; an input that is subscribed to a topic gets its value from
    /// another net. `None` while the names are not known: a loader that has just been restarted knows a command before them.
    #[must_use]
    pub fn settable_inputs(&self) -> Option<Vec<String>> {
        let names = NetInputs::deserialize(&self.names).ok()?;
        let settable = names.inputs.into_iter().filter(|one| one.topic.is_none());
        Some(settable.map(|one| one.primitive).collect())
    }
}

/// Names of the inputs of a net; other fields are ignored.
#[derive(Default, Deserialize)]
#[serde(default)]
struct NetInputs {
    inputs: Vec<InputName>,
}

#[derive(Deserialize)]
struct InputName {
    primitive: String,
    #[serde(default)]
    topic: Option<String>,
}

/// The fault that ended a net.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct FaultView {
    /// `device lost`, `jump`, `limit`, `panic`, `motion`, `overrun`.
    pub fault: String,
    /// The device concerned, if any.
    #[serde(default)]
    pub device: Option<String>,
    /// The joint concerned, if any.
    #[serde(default)]
    pub joint: Option<String>,
    /// Requested value, SI.
    pub value: f64,
    /// Allowed value, SI.
    pub limit: f64,
    /// Executor cycle.
    pub cycle: u64,
    /// Description in one sentence.
    pub words: String,
}

#[cfg(test)]
mod tests {
    use super::CommandView;

    #[test]
    fn of_several_nets_of_a_name_the_newest_counts_that_has_not_ended() {
        let command = |id, net: &str, state: &str| CommandView {
            id,
            net: net.to_owned(),
            state: state.to_owned(),
            loaded_at: 100 + id,
            ..CommandView::default()
        };
        let commands = [
            command(1, "lamp", "ready"),
            command(3, "lamp", "running"),
            command(2, "lamp", "canceling"),
            command(4, "lamp", "terminated"),
            command(5, "move", "loading"),
            command(6, "home", "ready"),
        ];
        let newest = CommandView::newest_of_each_net(&commands);
        let expected = [("home", (6, 106)), ("lamp", (3, 103))];
        assert_eq!(newest, expected.into());
    }
}
