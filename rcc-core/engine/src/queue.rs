//! What crosses between the real-time thread and the helper threads, through preallocated rings.
//! Whatever is handed to the real-time thread comes back and is freed elsewhere.

use rcc_core::message::{FaultRecord, Measurement, MonitorRecord};
use rcc_core::plan::ValuePoint;
use rcc_core::timing::LateCycle;
use rcc_ipc::BoardReader;
use rcc_ipc::control::{Answer, InputValue, NetValues, Refusal, SWITCH_MAX};
use rtrb::{Consumer, Producer};

use crate::net::Net;

/// Orders to the real-time thread that may wait.
pub const REQUESTS_MAX: usize = 256;
/// Outcomes that may wait for the intake thread; the real-time thread takes no order without room for its outcomes.
pub const REPLIES_MAX: usize = 1024;
/// Monitor records that may wait for the pump thread.
pub const RECORDS_MAX: usize = 16_384;
/// Events that may wait for the pump thread.
pub const EVENTS_MAX: usize = 4096;

/// To the real-time thread. `ticket` names the caller who waits for the answer.
#[allow(missing_docs)] // The fields are named in the sentence of their variant.
#[derive(Debug)]
pub enum EngineRequest {
    /// Gives out a row of the command table.
    Reserve { ticket: u64 },
    /// Makes a loading command ready.
    Install { ticket: u64, id: u64, net: Box<Net> },
    /// Another net for a ready command, prepared anew from where its arms rest; what was set waits in it. The other one
    /// comes back; this one does if the command is not ready.
    Renew { id: u64, net: Box<Net> },
    /// Makes a loading command rejected.
    Reject { ticket: u64, id: u64 },
    /// START.
    Start { ticket: u64, id: u64 },
    /// Hand-over: stops and starts commands between the same two cycles, or changes nothing; 0 names none.
    Handover {
        ticket: u64,
        stop: [u64; SWITCH_MAX],
        start: [u64; SWITCH_MAX],
    },
    /// CANCEL.
    Cancel { ticket: u64, id: u64 },
    /// ABORT.
    Abort { ticket: u64, id: u64 },
    /// Frees the row of a command that is not active.
    Unload { ticket: u64, id: u64 },
    /// Sets inputs of a ready or active command, all or none; the list comes back.
    Set {
        ticket: u64,
        id: u64,
        values: Vec<InputValue>,
    },
    /// Reads values of a command; what was read comes back.
    Read {
        ticket: u64,
        id: u64,
        reading: ValueReading,
    },
    /// Freezes the flight recorder.
    Record { ticket: u64 },
    /// Late cycles are acknowledged: what is latched begins anew.
    Acknowledge { ticket: u64 },
    /// A driver announced itself; its board replaces the device's last one.
    Attach {
        device: usize,
        incarnation: u64,
        board: Box<BoardReader<Measurement>>,
    },
    /// The driver with this incarnation is dead; its board is given back.
    Detach { device: usize, incarnation: u64 },
}

/// What is to be read, with room for it.
#[derive(Debug)]
pub struct ValueReading {
    /// Where it is.
    pub points: Vec<ValuePoint>,
    /// What is read.
    pub values: NetValues,
}

impl ValueReading {
    /// With as much room as the points need. Not for the real-time thread.
    pub fn of(points: Vec<ValuePoint>) -> ValueReading {
        let elements: usize = points.iter().map(|point| point.width as usize).sum();
        let values = NetValues {
            words: vec![0; elements],
            ..NetValues::default()
        };
        ValueReading { points, values }
    }
}

/// From the real-time thread to the intake thread.
#[allow(missing_docs)] // The fields are named in the sentence of their variant.
#[derive(Debug)]
pub enum EngineReply {
    /// An order is done or refused.
    Answer { ticket: u64, answer: Answer },
    /// What was read, or why not.
    Read {
        ticket: u64,
        reading: ValueReading,
        refused: Option<Refusal>,
    },
    /// A net that is not needed any more.
    Net(Box<Net>),
    /// Values that were set or refused.
    Values(Vec<InputValue>),
    /// A board that is not read any more.
    Board(Box<BoardReader<Measurement>>),
}

/// From the real-time thread to the log.
#[allow(missing_docs)] // The fields are named in the sentence of their variant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EngineEvent {
    /// A command changed its state (numbers of `CommandState` and `EndReason`).
    Command {
        cycle: u64,
        id: u64,
        state: u32,
        reason: u32,
        fault: FaultRecord,
    },
    /// A device changed its state from `was` to `state` (numbers of `DeviceState`); `age_ns` is the age of its last
    /// measurement when that is of no use any more, else 0; `driver` is the incarnation of its driver, 0 = none;
    /// `attached` is false when that driver was found dead.
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
    /// A cycle was late.
    Late(LateCycle),
    /// So many late cycles were acknowledged.
    Acknowledged { cycle: u64, late: u64 },
}

/// The real-time thread's ends of all rings.
#[derive(Debug)]
pub struct RtRingEnds {
    /// Orders in.
    pub requests: Consumer<EngineRequest>,
    /// Outcomes out.
    pub replies: Producer<EngineReply>,
    /// Monitor records out.
    pub records: Producer<MonitorRecord>,
    /// Events out.
    pub events: Producer<EngineEvent>,
}

/// The helper threads' ends.
#[derive(Debug)]
pub struct HelperRingEnds {
    /// Orders out.
    pub requests: Producer<EngineRequest>,
    /// Outcomes in.
    pub replies: Consumer<EngineReply>,
    /// Monitor records in.
    pub records: Consumer<MonitorRecord>,
    /// Events in.
    pub events: Consumer<EngineEvent>,
}

/// Makes all rings.
pub fn rings() -> (RtRingEnds, HelperRingEnds) {
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
