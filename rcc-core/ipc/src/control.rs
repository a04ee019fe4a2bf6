//! What loader and executor say to each other: the life cycle of the paper's figure 2 as calls.
//! Plain data; used by the executor's intake thread and by the loader, never by the real-time thread.

use rcc_core::frame::PrepareFault;
use rcc_core::plan::{
    Delay, InputPoint, KernelRun, MonitorPoint, NullRange, Plan, PlanError, PlanRegion,
    PublishPoint, Rate, Resource, RunBlock, ValuePoint,
};
use serde::{Deserialize, Serialize};

use crate::rehearsal::{PredictedViolation, RehearsalReport};
use crate::request::{REQUEST_MAX, RESPONSE_MAX};
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

/// Most commands that one [`Call::Switch`] stops, and most that it starts.
pub const SWITCH_MAX: usize = 8;

/// Most values that one [`Call::Set`] sets.
pub const SET_MAX: usize = 64;
/// Most elements that one [`Call::Set`] sets.
pub const SET_ELEMENTS_MAX: usize = 1024;

/// Most values that one [`Call::Read`] reads.
pub const READ_MAX: usize = 1024;
/// Most elements that one [`Call::Read`] reads.
pub const READ_ELEMENTS_MAX: usize = 1536;

/// Name of the executor's ring with the commands of a device.
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
    /// What to run, in order.
    pub runs: Vec<KernelRun>,
    /// Operands of all runs.
    pub operands: Vec<u32>,
    /// How the runs are divided among regions.
    pub blocks: Vec<RunBlock>,
    /// What is evaluated only under a condition.
    pub regions: Vec<PlanRegion>,
    /// What becomes null when a region ceases to be evaluated.
    pub blanks: Vec<NullRange>,
    /// Delayed links.
    pub delays: Vec<Delay>,
    /// Monitors.
    pub monitors: Vec<MonitorPoint>,
    /// Values that come from outside.
    pub inputs: Vec<InputPoint>,
    /// Values that other nets can read, by rising key of their topics.
    pub publishes: Vec<PublishPoint>,
    /// Number of path clocks.
    pub clocks: u32,
    /// In which cycles it is evaluated.
    pub rate: Rate,
    /// The net goes on with null when a device that it commands is lost.
    pub survives_device_loss: bool,
}

impl PlanData {
    /// The plan, borrowing these arrays.
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
    /// Its index in the plan.
    pub input: u32,
    /// One word an element: the bits of a Real or an Int; 0, 1 or 2 (null) of a Bool.
    pub words: Vec<u64>,
}

/// Values of a net, all of one cycle.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NetValues {
    /// Executor cycle in which the net was evaluated last; 0 = it was not yet evaluated, and these are its first values.
    pub cycle: u64,
    /// Its evaluations so far.
    pub evaluations: u64,
    /// Cycles from one evaluation to the next.
    pub every: u32,
    /// [`rcc_core::message::CommandState`] as a number.
    pub state: u32,
    /// The elements of all points, one after the other, as in [`InputValue`].
    pub words: Vec<u64>,
}

/// Why a value cannot be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InputFault {
    /// The plan has no input of this index.
    Unknown,
    /// It has another number of elements.
    Elements,
    /// An element is infinite, or no truth value.
    NoValue,
    /// An element is out of the input's range.
    OutOfRange,
    /// The request sets it twice.
    Twice,
    /// It comes from another net.
    Subscribed,
}

/// How the bytes of a call begin, in the order of [`Call`].
#[derive(Deserialize)]
enum CallHead {
    Reserve,
    Install { id: u64 },
}

/// The command of an encoded [`Call::Install`], without decoding its plan; `None` for all other calls and bytes.
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
    /// Gives out a command id in state `loading`.
    Reserve,
    /// Hands the plan of a `loading` command over; it becomes `ready` or `rejected`.
    Install {
        /// Command id.
        id: u64,
        /// Its plan.
        plan: PlanData,
    },
    /// The loader refused the text of a `loading` command: it becomes `rejected`.
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
        /// Ids of active commands, at most [`SWITCH_MAX`]; each ends `aborted` (one whose motion is over: `finished`).
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
    /// Forgets a command that is not active.
    Unload {
        /// Command id.
        id: u64,
    },
    /// Sets inputs of a ready or active command, all of them between the same two cycles, or none.
    Set {
        /// Command id.
        id: u64,
        /// At most [`SET_MAX`] with together at most [`SET_ELEMENTS_MAX`] elements.
        values: Vec<InputValue>,
    },
    /// Reads values of a command as its last evaluation left them, all of one cycle.
    Read {
        /// Command id.
        id: u64,
        /// At most [`READ_MAX`] with together at most [`READ_ELEMENTS_MAX`] elements.
        points: Vec<ValuePoint>,
    },
    /// Freezes the flight recorder's last seconds, which are then written to a file: ask with [`Call::Recorded`].
    Record,
    /// Whether the recording that was frozen in this cycle is in a file.
    Recorded {
        /// Of the answer to [`Call::Record`].
        cycle: u64,
    },
    /// Late cycles are acknowledged: what is latched begins anew.
    Acknowledge,
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
    /// A new command exists.
    Reserved {
        /// Its id.
        id: u64,
    },
    /// Done; `cycle` is the executor cycle in which it took effect (0 if no cycle was involved).
    Done {
        /// Executor cycle.
        cycle: u64,
    },
    /// As [`Answer::Done`], of a net that was rehearsed before.
    Rehearsed {
        /// Executor cycle.
        cycle: u64,
        /// What the rehearsal came to.
        rehearsed: RehearsalReport,
    },
    /// What became of a recording.
    Recorded(RecordingState),
    /// What was read.
    Values(NetValues),
    /// Refused; nothing changed, except that a refused plan makes its command `rejected`.
    Refused(Refusal),
    /// A hand-over is refused because of one of its commands; nothing changed.
    RefusedFor {
        /// Command id.
        id: u64,
        /// Why.
        refusal: Refusal,
    },
}

/// What became of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RecordingState {
    /// It is not over yet, or is being written.
    NotYet,
    /// It is in this file.
    Written {
        /// Its path.
        file: String,
    },
    /// It could not be written and is lost.
    Lost {
        /// Why.
        why: String,
    },
}

/// Why the executor refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal {
    /// The bytes were no call: caller and executor are of different builds.
    NotUnderstood,
    /// All rows of the command table are in use.
    TableFull,
    /// There is no such command.
    UnknownCommand,
    /// The command is in a state ([`rcc_core::message::CommandState`] as a number) that does not allow it.
    WrongState {
        /// The state.
        state: u32,
    },
    /// Another command holds a resource.
    Busy {
        /// Id of the holder.
        holder: u64,
        /// What it holds.
        resource: Resource,
    },
    /// The net has no `Cancel` primitive and can only be aborted.
    NotCancelable,
    /// A device that the net commands cannot be commanded now.
    DeviceNotReady {
        /// Device index.
        device: u32,
        /// [`rcc_core::message::DeviceState`] as a number.
        state: u32,
        /// The driver's reason number.
        reason: u32,
    },
    /// The first set-point is not where the device is held (`rcc_core::guard`).
    FirstSetPoint {
        /// Device index.
        device: u32,
        /// Joint, counted from 1.
        joint: u32,
        /// Set-point minus hold set-point, or the set-point that breaks a limit; rad.
        value: f64,
        /// What is allowed.
        limit: f64,
        /// [`rcc_core::guard::ViolationKind`] as a number.
        violation: u32,
    },
    /// A hand-over names more commands than this to stop or to start.
    SwitchTooLarge {
        /// [`SWITCH_MAX`].
        max: u32,
    },
    /// A hand-over names the command twice.
    NamedTwice,
    /// A hand-over starts nets of several rates that are not evaluated in a common cycle within a second.
    NeverTogether,
    /// The first set-point does not continue the motion of what a hand-over stops (`rcc_core::guard`).
    Continuation {
        /// Device index.
        device: u32,
        /// Joint, counted from 1.
        joint: u32,
        /// What was asked for: rad, rad/s or rad/s².
        value: f64,
        /// What is allowed.
        limit: f64,
        /// [`rcc_core::guard::ViolationKind`] as a number.
        violation: u32,
    },
    /// A hand-over would let go of an arm: the command claims it but has no set-point for it in its first cycle.
    LetsGo {
        /// Device index.
        device: u32,
    },
    /// The first cycle of the net ended with a fault ([`rcc_core::message::FaultCode`] as a number).
    FirstCycle {
        /// The code.
        code: u32,
    },
    /// The plan does not check.
    Plan(PlanError),
    /// The start values could not be computed.
    Prepare(PrepareFault),
    /// In its rehearsal the net breaks a limit of an arm.
    Foreseen(PredictedViolation),
    /// The nets would need more of a cycle than the cell's budget.
    Budget {
        /// What the net is expected to need, ns.
        needed_ns: u64,
        /// What those need that run in the same cycles, ns.
        in_use_ns: u64,
        /// What nets may need together, ns.
        budget_ns: u64,
    },
    /// Another command that runs publishes or subscribes to a topic with values of another type or unit.
    OtherTopic {
        /// The other command.
        other: u64,
        /// [`rcc_core::topic::Topic::key`].
        key: u64,
    },
    /// A value cannot be set.
    Input {
        /// Index of the input in the plan.
        input: u32,
        /// Why.
        fault: InputFault,
    },
    /// A request reads more values, or more elements, than this.
    ReadTooLarge {
        /// [`READ_MAX`].
        values: u32,
        /// [`READ_ELEMENTS_MAX`].
        elements: u32,
    },
    /// A value to be read lies outside of the net.
    NoSuchValue {
        /// Its place in the list.
        value: u32,
    },
    /// A request sets more values, or more elements, than this.
    SetTooLarge {
        /// [`SET_MAX`].
        values: u32,
        /// [`SET_ELEMENTS_MAX`].
        elements: u32,
    },
    /// The executor has no room for it now; try again.
    Overloaded,
    /// The executor is stopping.
    Stopping,
    /// The cell's configuration switches the flight recorder off.
    NoRecorder,
    /// A CANCEL or ABORT came before the START had begun: the command stays ready.
    Withdrawn,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_told_from_other_calls_by_the_beginning_of_its_bytes() {
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
