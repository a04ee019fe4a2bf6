//! What travels over HTTP: the same structures for the server and for the command line.
//! Plain data, used by threads that are not real-time. All values SI, all times in nanoseconds.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// An error, with the same codes as on the command line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorBody {
    /// `RCC1xxx` language, `RCC2xxx` configuration, `RCC3xxx` life cycle, `RCC4xxx` processes.
    pub code: String,
    /// What is wrong, and where.
    pub message: String,
    /// What to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// All faults of a text.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diagnostics: Vec<Finding>,
}

/// One fault or warning in a text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Finding {
    /// `RCC1xxx` and others.
    pub code: String,
    /// `error` or `warning`.
    pub severity: String,
    /// What is wrong.
    pub message: String,
    /// Where.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<TextLocation>,
    /// Where the text with the fault is used, if that is another place: the instance of a fragment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub used_at: Option<TextLocation>,
    /// What to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// For people: with a snippet of the text, without colour.
    #[serde(default)]
    pub rendered: String,
}

/// A place in a text, counted from 1.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = Place)]
pub struct TextLocation {
    /// The text's name.
    pub file: String,
    /// Line.
    pub line: usize,
    /// Column, in characters.
    pub column: usize,
    /// Length in bytes, at most to the end of the line.
    #[serde(default)]
    pub length: usize,
    /// What is said at the place.
    #[serde(default)]
    pub label: String,
}

/// Answer to LOAD.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Loaded {
    /// The command's id.
    pub id: u64,
    /// `loading`.
    pub state: String,
}

/// Answer to START, CANCEL, ABORT and UNLOAD.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Done {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Executor cycle in which it took effect, 0 if none was involved.
    pub cycle: u64,
}

/// A command as a request names it: its id, the net's name, or `name#id`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
#[schema(as = Named)]
pub enum CommandRef {
    /// An id.
    Id(u64),
    /// A name (of several nets of that name the newest that it suits), `name#id`, or an id as text.
    Name(String),
}

/// What START may ask for besides.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Commands that end between the same two cycles; if the net cannot take over from them, nothing changes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub after_stopping: Vec<CommandRef>,
}

/// A hand-over: all of it between the same two cycles, or nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// Active commands that end, at most 8.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stop: Vec<CommandRef>,
    /// Ready commands that begin, at most 8.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub start: Vec<CommandRef>,
}

/// Answer to a hand-over.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Switched {
    /// Executor cycle in which the started ones were evaluated first; the stopped ones' last was the one before.
    pub cycle: u64,
    /// What ended, as it was named.
    pub stopped: Vec<Done>,
    /// What began, as it was named.
    pub started: Vec<Done>,
}

/// Answer to setting inputs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct InputsSet {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Executor cycle from which on they count: the net's next evaluation in or after it sees all of them.
    pub cycle: u64,
    /// What was set, in the order of the request.
    pub set: Vec<String>,
}

/// Values of ports of one net, all of one cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ValuesView {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// `ready running canceling terminated`.
    pub state: String,
    /// Executor cycle in which the net was evaluated last; 0: not yet, and these are its first values.
    pub cycle: u64,
    /// Its evaluations so far.
    pub net_cycle: u64,
    /// Logical time of that evaluation since START, s.
    pub time_s: f64,
    /// By port, in the order of the net.
    pub values: Vec<ValueView>,
}

/// The value of a port.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ValueView {
    /// `primitive.port`, or `primitive.port[index]`.
    pub port: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit, where the type does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// A number, a truth value, or a list of them; null is null, and what is infinite is the text `inf` or `-inf`.
    #[schema(value_type = Object)]
    pub value: serde_json::Value,
}

/// Answer to a request for an incident file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Frozen {
    /// Executor cycle in which the recording was frozen; the file holds the seconds before it and a little after.
    pub cycle: u64,
    /// The executor's life, 16 hexadecimal digits: the file's name begins with it.
    pub executor: String,
    /// The file, written whole.
    pub file: String,
}

/// A command.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
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
    /// Of a terminated command: `finished canceled aborted fault`.
    #[serde(default)]
    pub reason: Option<String>,
    /// Of a fault: what happened.
    #[serde(default)]
    pub fault: Option<FaultView>,
    /// It has a `Cancel` primitive.
    pub can_cancel: bool,
    /// Cycles evaluated since START.
    pub cycles: u64,
    /// Executor cycle of the first evaluation, 0 = none.
    pub started_cycle: u64,
    /// Executor cycle of the last evaluation, 0 = none.
    pub ended_cycle: u64,
    /// Time of the last evaluation, ns.
    pub exec_last_ns: u64,
    /// Longest evaluation, ns.
    pub exec_max_ns: u64,
    /// Mean of all evaluations, ns.
    #[serde(default)]
    pub exec_mean_ns: u64,
    /// What one evaluation is expected to take on this machine, ns; 0 = not known.
    #[serde(default)]
    pub expected_ns: u64,
    /// Number of primitives.
    #[serde(default)]
    pub primitives: u32,
    /// Unique resources, for people: `lwr`, `lwr.torch`.
    #[serde(default)]
    pub uses: Vec<String>,
    /// Seconds since the epoch at which it was loaded.
    #[serde(default)]
    pub loaded_at: u64,
    /// Of a net that commands an arm: what it did when it was run through virtual time before it became ready.
    #[serde(default)]
    pub rehearsal: Option<RehearsalView>,
    /// Faults and warnings of its text.
    #[serde(default)]
    pub diagnostics: Vec<Finding>,
}

/// What a net did when it was run through virtual time, before anything was commanded.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RehearsalView {
    /// Virtual time that was checked, s.
    pub time_s: f64,
    /// `finished`: to its end; `waits`: until nothing moved any more; `too long`: it goes on after what was checked;
    /// `elsewhere`: nothing was checked, START does it.
    pub end: String,
    /// Smallest distance to a singularity, `null` = not known.
    #[serde(default)]
    pub singularity: Option<f64>,
    /// Greatest use of limits, for velocity, acceleration and jerk; none if nothing moved.
    #[serde(default)]
    pub peaks: Vec<PeakView>,
    /// All of it for people.
    pub words: String,
    /// What it took, ns.
    pub took_ns: u64,
}

/// How much of a limit was used.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PeakView {
    /// `speed`, `acceleration` or `jerk`.
    pub of: String,
    /// The device.
    pub device: String,
    /// The joint.
    pub joint: String,
    /// Value in parts of the limit; 1 = all of it.
    pub share: f64,
}

/// A command with its text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CommandDetail {
    /// The command.
    #[serde(flatten)]
    pub command: CommandView,
    /// The text that was loaded.
    pub text: String,
    /// Where every port and monitor lies in the plan.
    #[serde(default)]
    #[schema(value_type = Object)]
    pub names: serde_json::Value,
}

/// What ended a net.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FaultView {
    /// `device lost`, `jump`, `limit`, `panic`, `motion`, `overrun`.
    pub fault: String,
    /// The device, if one is concerned.
    #[serde(default)]
    pub device: Option<String>,
    /// The joint, if one is concerned.
    #[serde(default)]
    pub joint: Option<String>,
    /// What was asked for, SI.
    pub value: f64,
    /// What is allowed, SI.
    pub limit: f64,
    /// Executor cycle.
    pub cycle: u64,
    /// The whole in one sentence.
    pub words: String,
}

/// A topic: a value that goes from net to net.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TopicView {
    /// Its name.
    pub topic: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit; null: the type says it, or there is none.
    pub unit: Option<String>,
    /// Nets that publish it; at most one of them runs.
    pub publishers: Vec<TopicEnd>,
    /// Nets that subscribe to it.
    pub subscribers: Vec<TopicEnd>,
}

/// A net at one end of a topic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
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
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviceView {
    /// Its name.
    pub name: String,
    /// Its driver's name.
    pub driver: String,
    /// `offline online ready commanded stopping`, as the executor sees it.
    pub state: String,
    /// Why it is not ready, in the driver's words; empty when it is fine.
    #[serde(default)]
    pub reason: String,
    /// The net that holds it, as `net#id`.
    #[serde(default)]
    pub holder: Option<String>,
    /// Quality of the connection in thousandths, 1000 is best.
    pub quality_permille: u32,
    /// Times that the executor found its board stale.
    pub losses: u64,
    /// Process of the driver, 0 = none.
    pub pid: u32,
    /// Names of its joints.
    pub joints: Vec<String>,
    /// Its channels.
    pub channels: Vec<ChannelView>,
}

/// A channel of a device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ChannelView {
    /// Its name.
    pub name: String,
    /// `digital input`, `digital output`, `analog input`, `analog output`.
    pub kind: String,
    /// Its unit.
    pub unit: String,
    /// Of an output: what becomes of it when nobody commands it.
    #[serde(default)]
    pub on_release: Option<String>,
}

/// The whole cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatusView {
    /// The cell's name.
    pub cell: String,
    /// The configuration's file.
    pub config: String,
    /// What is wrong with it, a sentence each: its files say something else than what is in force, or processes were
    /// started with different ones. Empty: nothing.
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
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct HelperView {
    /// `executor` or `loader`.
    pub process: String,
    /// Its name.
    pub name: String,
    /// `waiting running hanging ended panicked`.
    pub state: String,
    /// Turns so far.
    pub turns: u64,
    /// Time since the last one.
    pub age_ns: u64,
    /// How long one may take: beyond it the process's heartbeat stops.
    pub limit_ns: u64,
}

/// A late cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LateView {
    /// Its number.
    pub cycle: u64,
    /// `woken late` or `computed long`: which was the greater part of the lateness.
    pub cause: String,
    /// How long after its deadline it woke.
    pub wake_ns: u64,
    /// How long it computed.
    pub exec_ns: u64,
    /// Periods that it skipped.
    pub skipped_periods: u64,
    /// The net that computed longest in it, if one ran.
    #[serde(default)]
    pub net: Option<String>,
    /// How long that took.
    pub net_ns: u64,
}

/// The answer to an acknowledgement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Acknowledged {
    /// Executor cycle from which on everything is counted anew.
    pub cycle: u64,
    /// Late cycles that were acknowledged.
    pub late: u64,
}

/// Times since the last acknowledgement or the start, and what primitives cost.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TimingView {
    /// Cycle at which this was written.
    pub cycle: u64,
    /// Cycle of the last acknowledgement, 0 = there was none.
    pub acknowledged_cycle: u64,
    /// Base period.
    pub period_ns: u64,
    /// Wake-up after the deadline.
    pub wake: HistogramView,
    /// From the wake-up until everything is written.
    pub exec: HistogramView,
    /// From one wake-up to the next.
    pub length: HistogramView,
    /// Types of primitives that ran, the dearest first.
    pub primitives: Vec<PrimitiveTimeView>,
}

/// A distribution of times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistogramView {
    /// How many.
    pub count: u64,
    /// The shortest.
    pub min_ns: u64,
    /// The mean.
    pub mean_ns: u64,
    /// Half of them are at most this long, to 6 %.
    pub p50_ns: u64,
    /// 99 % are at most this long, to 6 %.
    pub p99_ns: u64,
    /// 99.9 % are at most this long, to 6 %.
    pub p999_ns: u64,
    /// The longest.
    pub max_ns: u64,
    /// The occupied buckets.
    pub buckets: Vec<BucketView>,
}

/// Times up to a bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct BucketView {
    /// Upper bound, inclusive.
    pub to_ns: u64,
    /// How many lie between the bound before and this one.
    pub count: u64,
}

/// What the primitives of a type cost, by samples: the sums of several types are in the ratio of what they cost
/// altogether.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PrimitiveTimeView {
    /// The type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Runs of equal primitives that were timed.
    pub runs: u64,
    /// Primitives in them.
    pub primitives: u64,
    /// Their time together.
    pub sum_ns: u64,
    /// The longest run.
    pub max_ns: u64,
}

/// The executor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExecutorView {
    /// Its process.
    pub pid: u32,
    /// Which life of a process, 16 hexadecimal digits.
    pub incarnation: String,
    /// Number of the newest cycle, without gaps from 1.
    pub cycle: u64,
    /// Base period.
    pub period_ns: u64,
    /// Where the cycles' time comes from.
    pub clock: ClockView,
    /// Late cycles since its start.
    pub late: u64,
    /// Of them those that somebody acknowledged.
    #[serde(default)]
    pub late_acknowledged: u64,
    /// First late cycle since the last acknowledgement.
    #[serde(default)]
    pub first_late: Option<LateView>,
    /// Last late cycle since the last acknowledgement.
    #[serde(default)]
    pub last_late: Option<LateView>,
    /// Worst wake-up after the deadline since the last acknowledgement.
    pub worst_wake_ns: u64,
    /// Time that the last cycle computed.
    pub exec_last_ns: u64,
    /// Longest that a cycle computed since the last acknowledgement.
    pub exec_max_ns: u64,
    /// What nets may need together in one cycle; 0 = no limit.
    #[serde(default)]
    pub budget_ns: u64,
    /// What the nets that run now are expected to need together in one cycle.
    #[serde(default)]
    pub committed_ns: u64,
    /// Periods skipped because of late cycles.
    pub skipped_periods: u64,
    /// Monitor records lost before they left the executor.
    pub dropped_records: u64,
    /// Commands running now.
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

/// Where the executor's cycles take their time from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default)]
pub struct ClockView {
    /// `own`; or `searching`, `locked` or `unfit` for a clock that follows a device.
    pub state: String,
    /// The device that it follows.
    pub device: Option<String>,
    /// Mean time from where a cycle begins to where it should, ns.
    pub error_ns: f64,
    /// Mean deviation of a packet of the device from where it was expected, ns.
    pub jitter_ns: f64,
    /// The device's period by the executor's clock, ns; 0 = not known.
    pub device_period_ns: f64,
    /// How much longer than nominal that is, in millionths.
    pub rate_ppm: f64,
    /// Times that it was locked and lost that.
    pub losses: u64,
}

/// A process of the cell.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ProcessView {
    /// `executor`, `loader`, `driver`, …
    pub role: String,
    /// Which one.
    pub label: String,
    /// Its process id.
    pub pid: u32,
    /// Which life of a process, 16 hexadecimal digits.
    pub incarnation: String,
    /// False if it died and nobody cleaned up yet.
    pub alive: bool,
    /// Its word for people.
    pub note: String,
}

/// A primitive of the catalogue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PrimitiveView {
    /// Name of the type in nets.
    pub name: String,
    /// What it does.
    pub summary: String,
    /// What it is for: the chapter of the manual.
    #[serde(default)]
    pub group: String,
    /// What null does.
    pub null: String,
    /// Which known inputs have no result; empty: all have one.
    #[serde(default)]
    pub undefined: String,
    /// The formula and where it is from; may be empty.
    #[serde(default)]
    pub formula: String,
    /// Inputs.
    pub inputs: Vec<PortView>,
    /// Outputs.
    pub outputs: Vec<PortView>,
    /// Parameters.
    pub parameters: Vec<ParameterView>,
    /// True if it claims a resource for its net alone.
    pub unique: bool,
    /// True if it remembers something from cycle to cycle.
    #[serde(default)]
    pub remembers: bool,
    /// Worked values.
    #[serde(default)]
    pub examples: Vec<ExampleView>,
}

/// A port of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PortView {
    /// Its name.
    pub name: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit; equal letters stand for equal units.
    pub unit: String,
    /// What it carries.
    pub doc: String,
    /// Value of an input that nothing feeds; none: it must be connected.
    #[serde(default)]
    pub default: Option<String>,
    /// An output that may be left unread.
    #[serde(default)]
    pub diagnostic: bool,
    /// An output is never less than this.
    #[serde(default)]
    pub least: Option<f64>,
    /// An output is never greater than this.
    #[serde(default)]
    pub greatest: Option<f64>,
}

/// Worked values of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExampleView {
    /// What it shows.
    pub shows: String,
    /// Parameters as in a net; may be empty.
    pub parameters: String,
    /// The period of the net, ms.
    pub period_ms: u32,
    /// Names of ports.
    pub names: Vec<String>,
    /// One row a cycle, with a constant below each name.
    pub rows: Vec<Vec<String>>,
}

/// A parameter of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ParameterView {
    /// Its name.
    pub name: String,
    /// Its type, or what it names.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit.
    pub unit: String,
    /// What it means.
    pub doc: String,
    /// Its value when it is left out; none: it must be given.
    #[serde(default)]
    pub default: Option<String>,
    /// It must be greater than this.
    #[serde(default)]
    pub above: Option<f64>,
    /// It must not be less than this.
    #[serde(default)]
    pub at_least: Option<f64>,
    /// It must not be greater than this.
    #[serde(default)]
    pub at_most: Option<f64>,
}
