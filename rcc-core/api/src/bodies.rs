//! Bodies of requests and answers, shared by the server and the command line. Plain data for threads that are not
//! real-time. Values are in SI units, times in nanoseconds unless their name says otherwise.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

mod records;
mod rules;

pub use records::{
    EventPage, EventSourceView, EventView, HistoryPage, IncidentView, MonitoredValue,
};
pub use rules::{
    CommandList, LeaseBody, LeaseCommands, LeaseDone, LeaseGranted, OnClientLoss, RecordBody,
    RecordedView, RuleBody, RuleNumber, RuleView, RulesBody, RulesInstalled,
};

/// An error, with the same codes as on the command line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ErrorBody {
    /// `RCC1xxx` language, `RCC2xxx` configuration, `RCC3xxx` life cycle, `RCC4xxx` processes.
    pub code: String,
    /// The error and its location, for people.
    pub message: String,
    /// The remedy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// Errors and warnings of a text.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diagnostics: Vec<Finding>,
}

/// One error or warning in a text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Finding {
    /// `RCC1xxx` and others.
    pub code: String,
    /// `error` or `warning`.
    pub severity: String,
    /// The error or warning, for people.
    pub message: String,
    /// Its position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<TextLocation>,
    /// Where the faulty text is used, if that is elsewhere: the instance of a fragment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub used_at: Option<TextLocation>,
    /// The remedy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// For people: with a source snippet, without colour.
    #[serde(default)]
    pub rendered: String,
}

/// A position in a text, counted from 1.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Place))]
pub struct TextLocation {
    /// Name of the text.
    pub file: String,
    /// Line.
    pub line: usize,
    /// Column, in characters.
    pub column: usize,
    /// Length in bytes, at most to the end of the line.
    #[serde(default)]
    pub length: usize,
    /// Note at this position.
    #[serde(default)]
    pub label: String,
}

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

/// A command as named in a request: its id, the net's name, or `name#id`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(untagged)]
#[cfg_attr(feature = "openapi", schema(as = Named))]
pub enum CommandRef {
    /// An id.
    Id(u64),
    /// A name (of several nets with this name, the newest in a suitable state), `name#id`, or an id as text.
    Name(String),
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

/// Answer to setting inputs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct InputsSet {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Executor cycle from which they take effect: the net's next evaluation in or after it sees all of them.
    pub cycle: u64,
    /// The inputs that were set, in the order of the request.
    pub set: Vec<String>,
}

/// Values of ports of one net, all from one cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ValuesView {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// `ready running canceling terminated`.
    pub state: String,
    /// Executor cycle in which the net was last evaluated; 0 if not yet: the values are its initial ones.
    pub cycle: u64,
    /// Number of its evaluations.
    pub net_cycle: u64,
    /// Logical time of that evaluation since START, s.
    pub time_s: f64,
    /// The values by port, in the order of the net.
    pub values: Vec<ValueView>,
}

/// The value of a port.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ValueView {
    /// `primitive.port`, or `primitive.port[index]`.
    pub port: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit, if the type does not imply it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// A number, a truth value, or a list of them. Null is `null`; infinity is the text `inf` or `-inf`.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub value: serde_json::Value,
}

/// Answer to a request for an incident file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Frozen))]
pub struct WrittenIncident {
    /// Executor cycle in which the recording was frozen; the file contains the seconds before it and a short time after
    /// it.
    pub cycle: u64,
    /// Incarnation of the executor, 16 hexadecimal digits: the file's name begins with it.
    pub executor: String,
    /// Path of the complete file.
    pub file: String,
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

/// Returns true for the name of the state of an active command.
fn is_active(state: &str) -> bool {
    matches!(state, "running" | "canceling")
}

impl CommandView {
    /// Returns true while its net is evaluated in each cycle.
    #[must_use]
    pub fn is_active(&self) -> bool {
        is_active(&self.state)
    }
}

impl TopicEnd {
    /// Returns true while its net is evaluated in each cycle.
    #[must_use]
    pub fn is_active(&self) -> bool {
        is_active(&self.state)
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

/// A topic: a value that goes from net to net.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct TopicView {
    /// Its name.
    pub topic: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit; null if the type implies it or there is none.
    pub unit: Option<String>,
    /// Nets that publish it; at most one of them runs.
    pub publishers: Vec<TopicEnd>,
    /// Nets that subscribe to it.
    pub subscribers: Vec<TopicEnd>,
}

/// A net at one end of a topic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct TopicEnd {
    /// Id of the command.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// The primitive.
    pub primitive: String,
    /// The command's state.
    pub state: String,
}

/// A device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct DeviceView {
    /// Its name.
    pub name: String,
    /// Its driver's name.
    pub driver: String,
    /// `offline online ready commanded stopping`, as the executor sees it.
    pub state: String,
    /// Why it is not ready, in the driver's words; empty if it is fine.
    #[serde(default)]
    pub reason: String,
    /// The net that holds it, as `net#id`.
    #[serde(default)]
    pub holder: Option<String>,
    /// Quality of the connection in thousandths, 1000 is best.
    pub quality_permille: u32,
    /// Number of times that the executor found its board stale.
    pub losses: u64,
    /// Process id of the driver; 0 if there is none.
    pub pid: u32,
    /// Names of its joints.
    pub joints: Vec<String>,
    /// Its channels.
    pub channels: Vec<ChannelView>,
}

/// A channel of a device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ChannelView {
    /// Its name.
    pub name: String,
    /// `digital input`, `digital output`, `analog input`, `analog output`.
    pub kind: String,
    /// Its unit.
    pub unit: String,
    /// For an output: its value when nobody commands it.
    #[serde(default)]
    pub on_release: Option<String>,
}

/// Status of the whole cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StatusView {
    /// The cell's name.
    pub cell: String,
    /// The configuration's file.
    pub config: String,
    /// Problems of the configuration, one sentence each: its files differ from what is in force, or processes were
    /// started with different configurations. Empty if there are none.
    #[serde(default)]
    pub configuration: Vec<String>,
    /// The executor.
    pub executor: ExecutorView,
    /// All announced processes.
    pub processes: Vec<ProcessView>,
    /// The helper threads of executor and loader.
    #[serde(default)]
    pub helpers: Vec<HelperView>,
}

/// A helper thread of a process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct HelperView {
    /// `executor` or `loader`.
    pub process: String,
    /// Its name.
    pub name: String,
    /// `waiting running hanging ended panicked`.
    pub state: String,
    /// Number of signs of life (turns) so far.
    pub turns: u64,
    /// Time since the last turn, ns.
    pub age_ns: u64,
    /// Maximum time for a turn, ns: beyond it the process's heartbeat stops.
    pub limit_ns: u64,
}

/// A late cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct LateView {
    /// Number of the cycle.
    pub cycle: u64,
    /// `woken late` or `computed long`: the larger part of the lateness.
    pub cause: String,
    /// Delay of the wake-up after the deadline, ns.
    pub wake_ns: u64,
    /// Computing time of the cycle, ns.
    pub exec_ns: u64,
    /// Number of periods that were skipped.
    pub skipped_periods: u64,
    /// The net with the longest evaluation in it, if one ran.
    #[serde(default)]
    pub net: Option<String>,
    /// Duration of that evaluation, ns.
    pub net_ns: u64,
}

/// Answer to an acknowledgement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Acknowledged {
    /// Executor cycle from which worst values and histograms begin again.
    pub cycle: u64,
    /// Number of late cycles that were acknowledged.
    pub late: u64,
}

/// Distributions of times since the last acknowledgement or the start, and the cost of primitives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct TimingView {
    /// Executor cycle in which this was written.
    pub cycle: u64,
    /// Cycle of the last acknowledgement; 0 if there was none.
    pub acknowledged_cycle: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Delay of the wake-up after the deadline.
    pub wake: HistogramView,
    /// Time from the wake-up until everything is written.
    pub exec: HistogramView,
    /// Time from one wake-up to the next.
    pub length: HistogramView,
    /// Delay of the wake-up after the deadline, since the start of the executor: not reset by an acknowledgement.
    #[serde(default)]
    pub wake_since_start: TotalView,
    /// Time from the wake-up until everything is written, since the start of the executor.
    #[serde(default)]
    pub exec_since_start: TotalView,
    /// Types of primitives that ran, the most expensive first.
    pub primitives: Vec<PrimitiveTimeView>,
}

/// A distribution of times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct HistogramView {
    /// Number of samples.
    pub count: u64,
    /// Minimum, ns.
    pub min_ns: u64,
    /// Mean, ns.
    pub mean_ns: u64,
    /// Median, within 6 %, ns.
    pub p50_ns: u64,
    /// 99th percentile, within 6 %, ns.
    pub p99_ns: u64,
    /// 99.9th percentile, within 6 %, ns.
    pub p999_ns: u64,
    /// Maximum, ns.
    pub max_ns: u64,
    /// The buckets that are not empty.
    pub buckets: Vec<BucketView>,
}

/// A distribution of times that only grows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(default)]
pub struct TotalView {
    /// Number of samples.
    pub count: u64,
    /// Their sum, ns.
    pub sum_ns: u64,
    /// The buckets that are not empty.
    pub buckets: Vec<BucketView>,
}

/// One bucket of a histogram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct BucketView {
    /// Upper bound, inclusive, ns.
    pub to_ns: u64,
    /// Number of samples above the previous bound and up to this one.
    pub count: u64,
}

/// Cost of the primitives of one type, by sampling: the sums of several types are in the ratio of their total costs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PrimitiveTimeView {
    /// The type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Number of runs of equal primitives that were timed.
    pub runs: u64,
    /// Number of primitives in these runs.
    pub primitives: u64,
    /// Total time of these runs, ns.
    pub sum_ns: u64,
    /// Longest run, ns.
    pub max_ns: u64,
}

/// The executor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ExecutorView {
    /// Its process id.
    pub pid: u32,
    /// Incarnation of the process, 16 hexadecimal digits.
    pub incarnation: String,
    /// Number of the newest cycle; cycles are numbered from 1 without gaps.
    pub cycle: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// The time source of the cycles.
    pub clock: ClockView,
    /// Number of late cycles since its start.
    pub late: u64,
    /// Number of those that were acknowledged.
    #[serde(default)]
    pub late_acknowledged: u64,
    /// Number of late cycles since its start that woke late: the machine was busy, or did not run at all.
    #[serde(default)]
    pub late_woken: u64,
    /// Number of late cycles since its start that computed too long.
    #[serde(default)]
    pub late_computed: u64,
    /// First late cycle since the last acknowledgement.
    #[serde(default)]
    pub first_late: Option<LateView>,
    /// Last late cycle since the last acknowledgement.
    #[serde(default)]
    pub last_late: Option<LateView>,
    /// Longest delay of a wake-up since the last acknowledgement, ns.
    pub worst_wake_ns: u64,
    /// Computing time of the last cycle, ns.
    pub exec_last_ns: u64,
    /// Longest computing time of a cycle since the last acknowledgement, ns.
    pub exec_max_ns: u64,
    /// Time that all nets together may take in one cycle, ns; 0 if there is no limit.
    #[serde(default)]
    pub budget_ns: u64,
    /// Time that the running nets are expected to take together in one cycle, ns.
    #[serde(default)]
    pub committed_ns: u64,
    /// Number of periods skipped because of late cycles.
    pub skipped_periods: u64,
    /// Monitor records lost before they left the executor.
    pub dropped_records: u64,
    /// Number of recordings that the flight recorder handed over to be written to incident files, since its start.
    #[serde(default)]
    pub incidents: u64,
    /// Number of running commands.
    pub running: u32,
    /// SCHED_FIFO was granted.
    pub fifo: bool,
    /// Memory is locked.
    pub locked: bool,
    /// Pinned to a core.
    pub pinned: bool,
    /// `RT: granted (…)` or `RT: degraded, because …`.
    pub grade: String,
}

/// The time source of the executor's cycles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(default)]
pub struct ClockView {
    /// `own`; or `searching`, `locked` or `unfit` for a clock that follows a device.
    pub state: String,
    /// The device that it follows.
    pub device: Option<String>,
    /// Mean phase error of the cycles, ns.
    pub error_ns: f64,
    /// Mean deviation of the device's packets from their expected arrival, ns.
    pub jitter_ns: f64,
    /// Period of the device measured with the executor's clock, ns; 0 if not known.
    pub device_period_ns: f64,
    /// Deviation of that period from the nominal one, in millionths.
    pub rate_ppm: f64,
    /// Number of times that the lock was lost.
    pub losses: u64,
}

/// A process of the cell.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ProcessView {
    /// `executor`, `loader`, `driver`, …
    pub role: String,
    /// Label among the processes of this role.
    pub label: String,
    /// Its process id.
    pub pid: u32,
    /// Incarnation of the process, 16 hexadecimal digits.
    pub incarnation: String,
    /// False if the process is dead and nobody has cleaned up yet.
    pub alive: bool,
    /// Its note for people.
    pub note: String,
}

/// A primitive of the catalogue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PrimitiveView {
    /// Name of the type in nets.
    pub name: String,
    /// Description in one sentence.
    pub summary: String,
    /// Chapter of the manual.
    #[serde(default)]
    pub group: String,
    /// Effect of null inputs.
    pub null: String,
    /// Known inputs that have no result; empty if all have one.
    #[serde(default)]
    pub undefined: String,
    /// The formula and its source; may be empty.
    #[serde(default)]
    pub formula: String,
    /// Inputs.
    pub inputs: Vec<PortView>,
    /// Outputs.
    pub outputs: Vec<PortView>,
    /// Parameters.
    pub parameters: Vec<ParameterView>,
    /// True if it claims a resource exclusively for its net.
    pub unique: bool,
    /// True if it has state that persists from cycle to cycle.
    #[serde(default)]
    pub remembers: bool,
    /// Tables of worked values.
    #[serde(default)]
    pub examples: Vec<ExampleView>,
}

/// A port of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PortView {
    /// Its name.
    pub name: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit; equal letters stand for equal units.
    pub unit: String,
    /// Meaning of the value.
    pub doc: String,
    /// Value of an unconnected input; `None` if it must be connected.
    #[serde(default)]
    pub default: Option<String>,
    /// True for an output that may be left unread.
    #[serde(default)]
    pub diagnostic: bool,
    /// Lower bound of an output.
    #[serde(default)]
    pub least: Option<f64>,
    /// Upper bound of an output.
    #[serde(default)]
    pub greatest: Option<f64>,
}

/// A table of worked values of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ExampleView {
    /// Title of the example.
    pub shows: String,
    /// Parameters as in a net; may be empty.
    pub parameters: String,
    /// The period of the net, ms.
    pub period_ms: u32,
    /// Names of ports.
    pub names: Vec<String>,
    /// One row per cycle, with a constant below each name.
    pub rows: Vec<Vec<String>>,
}

/// A parameter of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ParameterView {
    /// Its name.
    pub name: String,
    /// Its type, or the kind of thing it names.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit.
    pub unit: String,
    /// Meaning of the parameter.
    pub doc: String,
    /// Default value; `None` if it is required.
    #[serde(default)]
    pub default: Option<String>,
    /// Exclusive lower bound.
    #[serde(default)]
    pub above: Option<f64>,
    /// Inclusive lower bound.
    #[serde(default)]
    pub at_least: Option<f64>,
    /// Inclusive upper bound.
    #[serde(default)]
    pub at_most: Option<f64>,
}
