//! Messages between the real-time thread and the helper threads, through preallocated rings. Everything that is handed
//! to the real-time thread comes back and is freed elsewhere.

use rcc_core::message::{FaultRecord, MonitorRecord};
use rcc_core::plan::ValuePoint;
use rcc_core::timing::LateCycle;
use rcc_protocol::control::{Answer, InputValue, NetValues, Refusal, SWITCH_MAX};
use rcc_protocol::rules::{Rule, RuleStatus};
use rtrb::{Consumer, Producer};

use crate::boards::{DeviceBoards, VirtualBoards};
use crate::net::Net;

/// Capacity of the ring of requests to the real-time thread.
pub const REQUESTS_MAX: usize = 256;
/// Capacity of the ring of replies to the intake thread; the real-time thread takes a request only if there is room for
/// its replies.
pub const REPLIES_MAX: usize = 1024;
/// Capacity of the ring of monitor records to the pump thread.
pub const RECORDS_MAX: usize = 16_384;
/// Capacity of the ring of events to the pump thread.
pub const EVENTS_MAX: usize = 4096;

/// A request to the real-time thread. `ticket` identifies the caller that waits for the answer.
#[allow(missing_docs)] // The fields are named in the sentence of their variant.
#[derive(Debug)]
pub enum EngineRequest<B: DeviceBoards = VirtualBoards> {
    /// Reserves a row of the command table.
    Reserve { ticket: u64 },
    /// Makes a loading command ready.
    Install { ticket: u64, id: u64, net: Box<Net> },
    /// Replaces the net of a ready command by one that was prepared again for the current rest positions of its arms;
    /// staged values move to it. The previous net comes back, or this one if the command is not ready.
    Renew { id: u64, net: Box<Net> },
    /// Makes a loading command rejected.
    Reject { ticket: u64, id: u64 },
    /// START. From then on the command is bound to `lease`; 0: to that to which it is bound already, if any.
    Start { ticket: u64, id: u64, lease: u64 },
    /// Hand-over: stops and starts commands between the same two cycles, or changes nothing; unused ids are 0. `lease` as
    /// for START.
    Handover {
        ticket: u64,
        stop: [u64; SWITCH_MAX],
        start: [u64; SWITCH_MAX],
        lease: u64,
    },
    /// CANCEL.
    Cancel { ticket: u64, id: u64 },
    /// ABORT.
    Abort { ticket: u64, id: u64 },
    /// UNLOAD: frees the row of a command that is not active.
    Unload { ticket: u64, id: u64 },
    /// Sets inputs of a ready or active command, all or none; the list comes back.
    Set {
        ticket: u64,
        id: u64,
        values: Vec<InputValue>,
    },
    /// Reads values of a command; the values come back in `reading`.
    Read {
        ticket: u64,
        id: u64,
        reading: ValueReading,
    },
    /// Installs all of these rules, or none; the list comes back.
    InstallRules { ticket: u64, rules: Vec<Rule> },
    /// Removes a rule.
    RemoveRule { ticket: u64, id: u64 },
    /// Lists the rules with ids above `after`, as many as the list has room for.
    ListRules {
        ticket: u64,
        after: u64,
        list: Vec<(Rule, RuleStatus)>,
    },
    /// Grants a lease.
    GrantLease { ticket: u64, expires_ns: u64 },
    /// Renews a lease.
    RenewLease { ticket: u64, lease: u64 },
    /// Ends a lease as if it had expired.
    EndLease { ticket: u64, lease: u64 },
    /// Binds commands to a lease; unused ids are 0.
    BindLease {
        ticket: u64,
        lease: u64,
        commands: [u64; SWITCH_MAX],
    },
    /// Freezes the recording of the flight recorder.
    Record { ticket: u64 },
    /// Acknowledges late cycles: resets latches, worst values and histograms.
    Acknowledge { ticket: u64 },
    /// A driver announced itself; its board replaces the previous board of the device.
    Attach {
        device: usize,
        incarnation: u64,
        board: Box<B::Measurements>,
    },
    /// The driver with this incarnation is dead; its board comes back.
    Detach { device: usize, incarnation: u64 },
}

/// Values to be read, with room for the result.
#[derive(Debug)]
pub struct ValueReading {
    /// Where the values are.
    pub points: Vec<ValuePoint>,
    /// The result.
    pub values: NetValues,
}

impl ValueReading {
    /// Allocates as much room as the points need. Not for the real-time thread.
    pub fn of(points: Vec<ValuePoint>) -> ValueReading {
        let elements: usize = points.iter().map(|point| point.width as usize).sum();
        let values = NetValues {
            words: vec![0; elements],
            ..NetValues::default()
        };
        ValueReading { points, values }
    }
}

/// A message from the real-time thread to the intake thread.
#[allow(missing_docs)] // The fields are named in the sentence of their variant.
#[derive(Debug)]
pub enum EngineReply<B: DeviceBoards = VirtualBoards> {
    /// A request was executed or refused.
    Answer { ticket: u64, answer: Answer },
    /// The result of a read, or why it was refused.
    Read {
        ticket: u64,
        reading: ValueReading,
        refused: Option<Refusal>,
    },
    /// The list of rules of an installation, to be freed.
    RuleList(Vec<Rule>),
    /// Installed rules.
    Rules {
        ticket: u64,
        list: Vec<(Rule, RuleStatus)>,
    },
    /// A net that is no longer needed.
    Net(Box<Net>),
    /// The list of values of a `Set` request, to be freed.
    Values(Vec<InputValue>),
    /// A board that is no longer read.
    Board(Box<B::Measurements>),
}

/// An event for the log, from the real-time thread.
#[allow(missing_docs)] // The fields are named in the sentence of their variant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EngineEvent {
    /// A command changed its state (numbers of `CommandState` and `EndReason`); `outcome` and `cycles` are those of its
    /// `CommandEntry`.
    Command {
        cycle: u64,
        id: u64,
        state: u32,
        reason: u32,
        outcome: u32,
        cycles: u64,
        fault: FaultRecord,
    },
    /// A device changed its state from `was` to `state` (numbers of `DeviceState`). `age_ns` is the age of its last
    /// measurement if that is stale or invalid, else 0; `driver` is the incarnation of its driver, 0: none; `attached`
    /// is false if the driver was found dead.
    Device {
        cycle: u64,
        device: u32,
        state: u32,
        was: u32,
        reason: u32,
        age_ns: u64,
        driver: u64,
        attached: bool,
    },
    /// A rule fired, was refused, expired or was disarmed.
    Rule(RuleStatus),
    /// A lease expired or was ended: so many rules were disarmed and commands canceled.
    LeaseLost {
        cycle: u64,
        lease: u64,
        rules: u32,
        commands: u32,
    },
    /// A cycle was late.
    Late(LateCycle),
    /// Late cycles were acknowledged; `late` is their number.
    Acknowledged { cycle: u64, late: u64 },
}

/// The real-time thread's ends of all rings.
#[derive(Debug)]
pub struct RtRingEnds<B: DeviceBoards = VirtualBoards> {
    /// Receives requests.
    pub requests: Consumer<EngineRequest<B>>,
    /// Sends replies.
    pub replies: Producer<EngineReply<B>>,
    /// Sends monitor records.
    pub records: Producer<MonitorRecord>,
    /// Sends events.
    pub events: Producer<EngineEvent>,
}

/// The helper threads' ends of all rings.
#[derive(Debug)]
pub struct HelperRingEnds<B: DeviceBoards = VirtualBoards> {
    /// Sends requests.
    pub requests: Producer<EngineRequest<B>>,
    /// Receives replies.
    pub replies: Consumer<EngineReply<B>>,
    /// Receives monitor records.
    pub records: Consumer<MonitorRecord>,
    /// Receives events.
    pub events: Consumer<EngineEvent>,
}

/// Allocates all rings.
pub fn rings<B: DeviceBoards>() -> (RtRingEnds<B>, HelperRingEnds<B>) {
    let (request_in, requests) = rtrb::RingBuffer::new(REQUESTS_MAX);
    let (replies, reply_out) = rtrb::RingBuffer::new(REPLIES_MAX);
    let (records, record_out) = rtrb::RingBuffer::new(RECORDS_MAX);
    let (events, event_out) = rtrb::RingBuffer::new(EVENTS_MAX);
    let rt = RtRingEnds {
        requests,
        replies,
        records,
        events,
    };
    (
        rt,
        HelperRingEnds {
            requests: request_in,
            replies: reply_out,
            records: record_out,
            events: event_out,
        },
    )
}
