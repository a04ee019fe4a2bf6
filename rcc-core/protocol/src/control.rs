//! Requests and answers between loader and executor: the life cycle of figure 2 of the paper as calls. Plain data; used
//! by the executor's intake thread and by the loader, never by the real-time thread.

use rcc_core::cycle::{ReadyRun, Schedule};
use rcc_core::plan::{
    Delay, InputPoint, KernelRun, MonitorPoint, NullRange, Plan, PlanRegion, PublishPoint, Rate,
    RunBlock, ValuePoint,
};
use serde::{Deserialize, Serialize};

pub use crate::limits::{READ_ELEMENTS_MAX, READ_MAX, SET_ELEMENTS_MAX, SET_MAX, SWITCH_MAX};
pub use crate::refusal::{InputFault, Refusal};

use crate::rehearsal::RehearsalReport;
use crate::rules::{ListedRule, NewRule};
use crate::wire::{self, Message};

/// Name of the executor's request service in its announcement.
pub const CONTROL: &str = "control";
/// Name of the board with [`rcc_core::message::CycleStatus`].
pub const STATUS: &str = "status";
/// Name of the board with [`rcc_core::message::Tables`].
pub const TABLES: &str = "tables";
/// Name of the board with [`rcc_core::timing::CycleTiming`].
pub const TIMING: &str = "timing";
/// Name of the board with [`rcc_core::helper::HelperTable`].
pub const HELPERS: &str = "helpers";
/// Name of the stream of [`rcc_core::message::MonitorRecord`].
pub const RECORDS: &str = "records";
/// Name of a driver's board with [`rcc_core::message::Measurement`].
pub const MEASUREMENT: &str = "measurement";

/// Maximum length of a request (a plan with its tables), bytes.
pub const REQUEST_MAX: usize = 4 << 20;
/// Maximum length of an answer, bytes.
pub const RESPONSE_MAX: usize = 16 << 10;

/// Returns the name of the executor's ring with the set-points of a device.
#[must_use]
pub fn command_board(device: &str) -> String {
    format!("command-{device}")
}

/// A plan that owns its arrays; see [`Plan`] for their meaning.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PlanData {
    /// Fingerprint of the catalogue.
    pub catalogue: u64,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// Initial arena of `Real`.
    pub reals: Vec<f64>,
    /// Initial arena of `Bool`.
    pub bools: Vec<u8>,
    /// Initial arena of `Int`.
    pub ints: Vec<i64>,
    /// Kernel runs, in order of evaluation.
    pub runs: Vec<KernelRun>,
    /// Operands of all runs.
    pub operands: Vec<u32>,
    /// How the runs are divided among regions.
    pub blocks: Vec<RunBlock>,
    /// Parts of the net that are evaluated only under a condition.
    pub regions: Vec<PlanRegion>,
    /// Slots that become null when a region stops being evaluated.
    pub blanks: Vec<NullRange>,
    /// Delayed links.
    pub delays: Vec<Delay>,
    /// Monitors.
    pub monitors: Vec<MonitorPoint>,
    /// Inputs that are set from outside the net.
    pub inputs: Vec<InputPoint>,
    /// Values that other nets can read, sorted by the keys of their topics.
    pub publishes: Vec<PublishPoint>,
    /// Number of path clocks.
    pub clocks: u32,
    /// Cycles in which the net is evaluated.
    pub rate: Rate,
    /// True if the net continues with null when a device that it commands is lost.
    pub survives_device_loss: bool,
}

impl PlanData {
    /// Looks up the kernels of the runs.
    #[must_use]
    pub fn ready_runs(&self) -> Box<[ReadyRun]> {
        self.runs.iter().map(ReadyRun::of).collect()
    }

    /// Returns what a cycle does, with `runs` from [`PlanData::ready_runs`].
    #[inline]
    #[must_use]
    pub fn schedule<'a>(&'a self, runs: &'a [ReadyRun]) -> Schedule<'a> {
        Schedule {
            runs,
            operands: &self.operands,
            blocks: &self.blocks,
            regions: &self.regions,
            blanks: &self.blanks,
            delays: &self.delays,
        }
    }

    /// Returns the plan, borrowing these arrays.
    #[must_use]
    pub fn plan(&self) -> Plan<'_> {
        Plan {
            catalogue: self.catalogue,
            configuration: self.configuration,
            reals: &self.reals,
            bools: &self.bools,
            ints: &self.ints,
            runs: &self.runs,
            operands: &self.operands,
            blocks: &self.blocks,
            regions: &self.regions,
            blanks: &self.blanks,
            delays: &self.delays,
            monitors: &self.monitors,
            inputs: &self.inputs,
            publishes: &self.publishes,
            clocks: self.clocks,
            rate: self.rate,
            survives_device_loss: self.survives_device_loss,
        }
    }
}

/// A new value for an [`InputPoint`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputValue {
    /// Index of the input in the plan.
    pub input: u32,
    /// One word per element: the bits of a Real or an Int; 0, 1 or 2 (null) for a Bool.
    pub words: Vec<u64>,
}

/// Values of a net, all from the same cycle.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NetValues {
    /// Executor cycle of the last evaluation; 0 if the net has not been evaluated yet and these are its initial values.
    pub cycle: u64,
    /// Number of evaluations so far.
    pub evaluations: u64,
    /// Cycles between two evaluations.
    pub every: u32,
    /// [`rcc_core::message::CommandState`] as a number.
    pub state: u32,
    /// Elements of all points, one after the other, encoded as in [`InputValue`].
    pub words: Vec<u64>,
}

/// First bytes of an encoded call; variants in the order of [`Call`].
#[derive(Deserialize)]
enum CallHead {
    Reserve,
    Install { id: u64 },
}

/// Returns the command id of an encoded [`Call::Install`] without decoding its plan; `None` for all other calls and
/// bytes.
#[must_use]
pub fn installs(bytes: &[u8]) -> Option<u64> {
    match wire::decode_beginning(bytes) {
        Ok(CallHead::Install { id }) => Some(id),
        Ok(CallHead::Reserve) | Err(_) => None,
    }
}

/// A request to the executor.
#[allow(clippy::large_enum_variant)] // One at a time, and sent at once.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Call {
    /// Allocates a command id in state `loading`.
    Reserve,
    /// Delivers the plan of a `loading` command, which becomes `ready` or `rejected`.
    Install {
        /// Command id.
        id: u64,
        /// The plan.
        plan: PlanData,
    },
    /// The loader refused the text of a `loading` command, which becomes `rejected`.
    Reject {
        /// Command id.
        id: u64,
    },
    /// START.
    Start {
        /// Command id.
        id: u64,
        /// The lease to which it is bound from then on; 0: as it is bound already, if it is.
        lease: u64,
    },
    /// Hand-over: stops some commands and starts others between the same two cycles, or changes nothing.
    Switch {
        /// Ids of active commands, at most [`SWITCH_MAX`]; each ends as `aborted` (as `finished` if its motion is
        /// over).
        stop: Vec<u64>,
        /// Ids of ready commands, at most [`SWITCH_MAX`].
        start: Vec<u64>,
        /// The lease to which the commands that start are bound from then on, as for START.
        lease: u64,
    },
    /// CANCEL.
    Cancel {
        /// Command id.
        id: u64,
    },
    /// ABORT.
    Abort {
        /// Command id.
        id: u64,
    },
    /// Removes a command that is not active.
    Unload {
        /// Command id.
        id: u64,
    },
    /// Sets inputs of a ready or active command: all of them between the same two cycles, or none.
    Set {
        /// Command id.
        id: u64,
        /// At most [`SET_MAX`] values with at most [`SET_ELEMENTS_MAX`] elements in total.
        values: Vec<InputValue>,
    },
    /// Reads values of a command as of its last evaluation, all from the same cycle.
    Read {
        /// Command id.
        id: u64,
        /// At most [`READ_MAX`] values with at most [`READ_ELEMENTS_MAX`] elements in total.
        points: Vec<ValuePoint>,
    },
    /// Freezes the last seconds of the flight recorder, to be written to a file; poll with [`Call::Recorded`].
    Record,
    /// Asks whether the recording frozen in this cycle has been written to a file.
    Recorded {
        /// Cycle from the answer to [`Call::Record`].
        cycle: u64,
    },
    /// Acknowledges late cycles: clears what is latched.
    Acknowledge,
    /// Installs rules: all of them between the same two cycles, or none.
    InstallRules {
        /// At most [`crate::rules::RULES_PER_REQUEST`] rules.
        rules: Vec<NewRule>,
    },
    /// Removes a rule; one that could still fire is disarmed.
    RemoveRule {
        /// Id of the rule.
        id: u64,
    },
    /// Lists installed rules with ids above this one, ascending, as many as fit into an answer.
    Rules {
        /// Id of the last rule that the caller knows; 0: from the first one.
        after: u64,
    },
    /// Grants a lease, which expires unless it is renewed.
    GrantLease {
        /// Time after which it expires, ns; between [`crate::rules::LEASE_MIN_NS`] and
        /// [`crate::rules::LEASE_MAX_NS`].
        expires_ns: u64,
    },
    /// Renews a lease.
    RenewLease {
        /// Id of the lease.
        lease: u64,
    },
    /// Ends a lease now, as if it had expired.
    EndLease {
        /// Id of the lease.
        lease: u64,
    },
    /// Binds commands to a lease: when it is lost, those that are active are canceled, or aborted if they cannot be.
    BindLease {
        /// Id of the lease.
        lease: u64,
        /// Ids of ready or active commands, at most [`SWITCH_MAX`].
        commands: Vec<u64>,
    },
}

impl Message for Call {
    const BYTES_MAX: usize = REQUEST_MAX;
    wire::once!();
}

impl Message for Answer {
    const BYTES_MAX: usize = RESPONSE_MAX;
    wire::once!();
}

/// The executor's answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    /// A new command was created.
    Reserved {
        /// Its id.
        id: u64,
    },
    /// Done; `cycle` is the executor cycle in which it took effect (0 if no cycle was involved).
    Done {
        /// Executor cycle.
        cycle: u64,
    },
    /// Like [`Answer::Done`], for a net that was rehearsed first.
    Rehearsed {
        /// Executor cycle.
        cycle: u64,
        /// Result of the rehearsal.
        rehearsed: RehearsalReport,
    },
    /// State of a recording.
    Recorded(RecordingState),
    /// The values that were read.
    Values(NetValues),
    /// Rules were installed; their ids are consecutive.
    RulesInstalled {
        /// Id of the first.
        first: u64,
        /// Executor cycle from which on their conditions are judged.
        cycle: u64,
    },
    /// Installed rules; empty if there are no more.
    Rules(Vec<ListedRule>),
    /// Refused. Nothing changed, except that a refused plan makes its command `rejected`.
    Refused(Refusal),
    /// A hand-over was refused because of one of its commands; nothing changed.
    RefusedFor {
        /// Command id.
        id: u64,
        /// The reason.
        refusal: Refusal,
    },
}

/// State of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RecordingState {
    /// The recording is still in progress or is being written.
    NotYet,
    /// The recording is in this file.
    Written {
        /// Its path.
        file: String,
    },
    /// The recording could not be written and is lost.
    Lost {
        /// The reason.
        why: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_encoded_plan_is_recognised_by_its_first_bytes() {
        let plan = PlanData::default();
        let calls = [
            (Call::Install { id: 1 << 40, plan }, Some(1 << 40)),
            (Call::Reserve, None),
            (Call::Reject { id: 7 }, None),
            (Call::Cancel { id: 7 }, None),
            (Call::Acknowledge, None),
        ];
        for (call, id) in calls {
            let bytes = wire::encode(&call).unwrap_or_default();
            assert_eq!(installs(&bytes), id, "{call:?}");
        }
        assert_eq!((installs(&[]), installs(&[1])), (None, None));
    }
}
