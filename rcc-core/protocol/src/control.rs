//! Requests and answers between loader and executor: the life cycle of figure 2 of the paper as calls. Plain data; used
//! by the executor's intake thread and by the loader, never by the real-time thread.

use rcc_core::cycle::{ReadyRun, Schedule};
use rcc_core::frame::PrepareFault;
use rcc_core::plan::{
    Delay, InputPoint, KernelRun, MonitorPoint, NullRange, Plan, PlanError, PlanRegion,
    PublishPoint, Rate, Resource, RunBlock, ValuePoint,
};
use serde::{Deserialize, Serialize};

use crate::rehearsal::{PredictedViolation, RehearsalReport};
use crate::rules::{ListedRule, NewRule, RuleFault};
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

/// Maximum number of commands that one [`Call::Switch`] stops, and maximum that it starts.
pub const SWITCH_MAX: usize = 8;

/// Maximum number of values in one [`Call::Set`].
pub const SET_MAX: usize = 64;
/// Maximum number of elements in one [`Call::Set`].
pub const SET_ELEMENTS_MAX: usize = 1024;

/// Maximum number of values in one [`Call::Read`].
pub const READ_MAX: usize = 1024;
/// Maximum number of elements in one [`Call::Read`].
pub const READ_ELEMENTS_MAX: usize = 1536;

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

/// Reason why a value cannot be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InputFault {
    /// The plan has no input with this index.
    Unknown,
    /// The input has another number of elements.
    Elements,
    /// An element is infinite, or is not a valid truth value.
    NoValue,
    /// An element is outside the input's range.
    OutOfRange,
    /// The request sets the input twice.
    Twice,
    /// The input is fed by another net.
    Subscribed,
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
    },
    /// Hand-over: stops some commands and starts others between the same two cycles, or changes nothing.
    Switch {
        /// Ids of active commands, at most [`SWITCH_MAX`]; each ends as `aborted` (as `finished` if its motion is
        /// over).
        stop: Vec<u64>,
        /// Ids of ready commands, at most [`SWITCH_MAX`].
        start: Vec<u64>,
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
    /// Binds commands to a lease: when it is lost, those that are active are cancelled, or aborted if they cannot be.
    BindLease {
        /// Id of the lease.
        lease: u64,
        /// Ids of ready or active commands, at most [`SWITCH_MAX`].
        commands: Vec<u64>,
    },
}

impl Message for Call {
    const BYTES_MAX: usize = REQUEST_MAX;
}

impl Message for Answer {
    const BYTES_MAX: usize = RESPONSE_MAX;
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

/// Reason for a refusal by the executor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal {
    /// The bytes are not a valid call: caller and executor are from different builds.
    NotUnderstood,
    /// All rows of the command table are in use.
    TableFull,
    /// No command with this id exists.
    UnknownCommand,
    /// The state of the command ([`rcc_core::message::CommandState`] as a number) does not allow the call.
    WrongState {
        /// The state.
        state: u32,
    },
    /// Another command holds a resource.
    Busy {
        /// Id of the command that holds it.
        holder: u64,
        /// The resource.
        resource: Resource,
    },
    /// The net has no `Cancel` primitive and can only be aborted.
    NotCancelable,
    /// A device that the net commands is not ready for commands.
    DeviceNotReady {
        /// Device index.
        device: u32,
        /// [`rcc_core::message::DeviceState`] as a number.
        state: u32,
        /// Reason number of the driver.
        reason: u32,
    },
    /// The first set-point is not at the position where the device is held (`rcc_core::guard`).
    FirstSetPoint {
        /// Device index.
        device: u32,
        /// Joint, counted from 1.
        joint: u32,
        /// Set-point minus hold set-point, or the set-point that breaks a limit; rad.
        value: f64,
        /// The allowed value.
        limit: f64,
        /// [`rcc_core::guard::ViolationKind`] as a number.
        violation: u32,
    },
    /// A hand-over stops or starts more commands than this.
    SwitchTooLarge {
        /// [`SWITCH_MAX`].
        max: u32,
    },
    /// A hand-over names the same command twice.
    NamedTwice,
    /// A hand-over starts nets of several rates that are not evaluated in a common cycle within a second.
    NeverTogether,
    /// The first set-point does not continue the motion of the command that the hand-over stops (`rcc_core::guard`).
    Continuation {
        /// Device index.
        device: u32,
        /// Joint, counted from 1.
        joint: u32,
        /// The commanded value: rad, rad/s or rad/s².
        value: f64,
        /// The allowed value.
        limit: f64,
        /// [`rcc_core::guard::ViolationKind`] as a number.
        violation: u32,
    },
    /// A hand-over would release an arm: the command claims it but has no set-point for it in its first cycle.
    LetsGo {
        /// Device index.
        device: u32,
    },
    /// The first cycle of the net ended with a fault ([`rcc_core::message::FaultCode`] as a number).
    FirstCycle {
        /// The fault code.
        code: u32,
    },
    /// The plan failed its check.
    Plan(PlanError),
    /// The start values could not be computed.
    Prepare(PrepareFault),
    /// The rehearsal shows that the net breaks a limit of an arm.
    Foreseen(PredictedViolation),
    /// The nets would need more of a cycle than the budget of the cell.
    Budget {
        /// Expected time of the net, ns.
        needed_ns: u64,
        /// Time of the nets that run in the same cycles, ns.
        in_use_ns: u64,
        /// Budget for all nets together, ns.
        budget_ns: u64,
    },
    /// Another running command publishes or subscribes to the topic with another type or unit.
    OtherTopic {
        /// Id of the other command.
        other: u64,
        /// [`rcc_core::topic::Topic::key`].
        key: u64,
    },
    /// A value cannot be set.
    Input {
        /// Index of the input in the plan.
        input: u32,
        /// The reason.
        fault: InputFault,
    },
    /// A request reads more values or elements than this.
    ReadTooLarge {
        /// [`READ_MAX`].
        values: u32,
        /// [`READ_ELEMENTS_MAX`].
        elements: u32,
    },
    /// A value to be read is outside the net.
    NoSuchValue {
        /// Index of the value in the request.
        value: u32,
    },
    /// A request sets more values or elements than this.
    SetTooLarge {
        /// [`SET_MAX`].
        values: u32,
        /// [`SET_ELEMENTS_MAX`].
        elements: u32,
    },
    /// The executor is too busy now; try again.
    Overloaded,
    /// The executor is stopping.
    Stopping,
    /// The configuration of the cell switches the flight recorder off.
    NoRecorder,
    /// A CANCEL or ABORT arrived before the START had taken effect: the command stays ready.
    Withdrawn,
    /// A rule cannot be installed, or a lease cannot be used.
    Rule {
        /// Index of the rule in the request; 0 for a lease.
        index: u32,
        /// The reason.
        fault: RuleFault,
    },
    /// A rule cannot be installed because of one of its commands.
    RuleCommand {
        /// Index of the rule in the request.
        index: u32,
        /// State of the command ([`rcc_core::message::CommandState`] as a number); 0: it does not exist.
        state: u32,
    },
    /// No rule with this id exists.
    UnknownRule,
    /// The time after which a lease expires is out of range.
    LeaseTime {
        /// [`crate::rules::LEASE_MIN_NS`].
        min_ns: u64,
        /// [`crate::rules::LEASE_MAX_NS`].
        max_ns: u64,
    },
    /// All leases are in use.
    LeasesFull {
        /// [`crate::rules::LEASES_MAX`].
        max: u32,
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
