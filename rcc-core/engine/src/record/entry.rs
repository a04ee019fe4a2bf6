//! What the flight recorder's ring consists of: records of words, one after the other, each with a head that says what
//! it is and how long. Written by the real-time thread, read by replay, which trusts nothing in them.

use bytemuck::Zeroable;
use rcc_core::frame::DeviceInput;
use rcc_core::message::{FaultCode, FaultRecord, Measurement};

use crate::net::Evaluation;

/// Words of a [`Measurement`].
pub const MEASUREMENT_WORDS: usize = size_of::<Measurement>() / 8;

/// What kind of record it is, in the lowest byte of its head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum RecordTag {
    Cycle = 1,
    Input = 2,
    Request = 3,
    State = 4,
    Net = 5,
    Snapshot = 6,
    TooLarge = 7,
    Times = 8,
    Set = 9,
}

const RECORD_TAGS: [RecordTag; 9] = [
    RecordTag::Cycle,
    RecordTag::Input,
    RecordTag::Request,
    RecordTag::State,
    RecordTag::Net,
    RecordTag::Snapshot,
    RecordTag::TooLarge,
    RecordTag::Times,
    RecordTag::Set,
];

/// The head of a record: tag, a small number, flags, and how many words follow.
pub(super) const fn head(tag: RecordTag, small: u8, flags: u16, words: usize) -> u64 {
    tag as u64 | (small as u64) << 8 | (flags as u64) << 16 | (words as u64) << 32
}

/// The head of a record is that of a cycle; its number follows.
pub(crate) fn is_cycle(head: u64) -> bool {
    head as u8 == RecordTag::Cycle as u8
}

/// The head of a record is that of a net's evaluation or state; its id follows.
pub(crate) fn is_of_net(head: u64) -> bool {
    [
        RecordTag::Net as u8,
        RecordTag::Snapshot as u8,
        RecordTag::TooLarge as u8,
    ]
    .contains(&(head as u8))
}

/// In the flags of a net: it began in this cycle, from its initial state.
pub(super) const BEGINS: u16 = 1;
/// In the flags of a net or a snapshot: CANCEL was requested.
pub(super) const CANCEL: u16 = 2;

/// The flags of a net say how many times it was prepared anew (the lowest bits of it): only an evaluation of the net that
/// an incident has can be compared.
pub(super) fn prepared_again_flags(prepared_again: u8) -> u16 {
    u16::from(prepared_again) << 8
}

/// An order as a number, with what it is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum RequestKind {
    /// LOAD, its second half.
    Install = 2,
    /// A load that failed.
    Reject = 3,
    /// START.
    Start = 4,
    /// CANCEL.
    Cancel = 5,
    /// ABORT.
    Abort = 6,
    /// UNLOAD.
    Unload = 7,
    /// A driver's board came.
    Attach = 8,
    /// A driver's board went.
    Detach = 9,
    /// An incident was asked for.
    Record = 10,
    /// Anything else: what changes is in the records of states.
    Other = 11,
    /// Values were set.
    Set = 12,
    /// Values were read.
    Read = 13,
    /// A net was prepared anew.
    Renew = 14,
}

/// What came of one evaluation, as a number.
pub(super) fn outcome_number(evaluation: Evaluation) -> u8 {
    match evaluation {
        Evaluation::Running => 0,
        Evaluation::Terminated => 1,
        Evaluation::Fault(code) => 16 + code as u8,
    }
}

fn outcome_of(number: u8) -> Option<Evaluation> {
    match number {
        0 => Some(Evaluation::Running),
        1 => Some(Evaluation::Terminated),
        _ => {
            let (code, _) = FaultCode::ALL.get(usize::from(number.checked_sub(16)?))?;
            Some(Evaluation::Fault(*code))
        }
    }
}

/// One record, as read.
#[derive(Clone, Copy, Debug)]
pub enum RecordEntry<'a> {
    /// A cycle begins.
    Cycle {
        /// Its number.
        cycle: u64,
        /// CLOCK_MONOTONIC at which it woke.
        woke_ns: u64,
    },
    /// What a device's ports show from this cycle on.
    Input {
        /// Index of the device.
        device: usize,
        /// Its `Measurement` as the nets see it; `None`: the device is not present.
        words: Option<&'a [u64; MEASUREMENT_WORDS]>,
    },
    /// An order was obeyed or refused.
    Request {
        /// [`RequestKind`].
        kind: u8,
        /// Id of the command, or index of the device.
        id: u64,
    },
    /// A command changed its state.
    State {
        /// Its id.
        id: u64,
        /// `CommandState`.
        state: u32,
        /// `EndReason`.
        reason: u32,
        /// Of a fault: what happened.
        fault: FaultRecord,
    },
    /// A net was evaluated.
    Net {
        /// Its id.
        id: u64,
        /// From its initial state.
        begins: bool,
        /// CANCEL was requested.
        cancel: bool,
        /// How many times it was prepared anew, as [`crate::net::StartConditions::prepared_again`].
        prepared_again: u8,
        /// What came of it.
        evaluation: Evaluation,
        /// The engine's period, s.
        dt_s: f64,
        /// Its cycles so far, this one included.
        cycles: u64,
        /// The hash of all its slots afterwards.
        hash: u64,
    },
    /// A value that is set from outside; the evaluation that follows sees it.
    Set {
        /// The net's id.
        id: u64,
        /// Index of the input in the plan.
        input: u32,
        /// Its elements.
        words: &'a [u64],
        /// So many evaluations of the net could have seen it before, had they been.
        late: u16,
    },
    /// The state of a net after its evaluation in this cycle.
    Snapshot(Snapshot<'a>),
    /// A net whose snapshot does not fit.
    TooLarge {
        /// Its id.
        id: u64,
        /// Words that it would need.
        words: u64,
    },
    /// How the cycle went in time.
    Times {
        /// How long after its time it woke.
        wake_ns: u64,
        /// How long it computed.
        exec_ns: u64,
        /// Periods that were skipped after it.
        skipped: u64,
    },
}

/// The state of a net.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// Its id.
    pub id: u64,
    /// Its cycles so far.
    pub cycles: u64,
    /// CANCEL was requested.
    pub cancel: bool,
    /// Arena of `Real`.
    pub reals: &'a [u64],
    /// Arena of `Int`.
    pub ints: &'a [u64],
    /// Arena of `Bool`, eight to a word.
    pub bools: &'a [u64],
    /// Motions.
    pub motions: &'a [u64],
}

/// Words that are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("word {at} of the recording is no record that this build knows")]
pub struct UnknownRecord {
    /// Where.
    pub at: usize,
}

/// Reads the records of a ring one after the other.
#[derive(Clone, Debug)]
pub struct RecordEntries<'a> {
    words: &'a [u64],
    at: usize,
}

impl<'a> RecordEntries<'a> {
    /// The records in these words.
    pub fn new(words: &'a [u64]) -> RecordEntries<'a> {
        RecordEntries { words, at: 0 }
    }
}

impl<'a> Iterator for RecordEntries<'a> {
    type Item = Result<RecordEntry<'a>, UnknownRecord>;

    fn next(&mut self) -> Option<Self::Item> {
        let head = *self.words.get(self.at)?;
        let at = self.at;
        let length = (head >> 32) as usize;
        let words = self.words.get(at + 1..).and_then(|rest| rest.get(..length));
        let entry = words.and_then(|words| read(head, words));
        self.at = match entry {
            Some(_) => at + 1 + length,
            None => self.words.len(),
        };
        Some(entry.ok_or(UnknownRecord { at }))
    }
}

fn read(head: u64, words: &[u64]) -> Option<RecordEntry<'_>> {
    let tag = RECORD_TAGS.get((head as u8).checked_sub(1)? as usize)?;
    let (small, flags) = ((head >> 8) as u8, (head >> 16) as u16);
    Some(match (tag, words) {
        (RecordTag::Cycle, &[cycle, woke_ns]) => RecordEntry::Cycle { cycle, woke_ns },
        (RecordTag::Input, words) => RecordEntry::Input {
            device: usize::from(small),
            words: match words {
                [] => None,
                words => Some(words.try_into().ok()?),
            },
        },
        (RecordTag::Request, &[id]) => RecordEntry::Request { kind: small, id },
        (RecordTag::State, &[id, state, ref fault @ ..]) => RecordEntry::State {
            id,
            state: state as u32,
            reason: (state >> 32) as u32,
            fault: bytemuck::try_pod_read_unaligned(bytemuck::cast_slice(fault)).ok()?,
        },
        (RecordTag::Net, &[id, cycles, dt_s, hash]) => RecordEntry::Net {
            id,
            begins: flags & BEGINS != 0,
            cancel: flags & CANCEL != 0,
            prepared_again: (flags >> 8) as u8,
            evaluation: outcome_of(small)?,
            dt_s: f64::from_bits(dt_s),
            cycles,
            hash,
        },
        (RecordTag::Set, &[id, input, ref words @ ..]) => RecordEntry::Set {
            id,
            input: u32::try_from(input).ok()?,
            words,
            late: flags,
        },
        (RecordTag::Snapshot, words) => RecordEntry::Snapshot(snapshot(flags, words)?),
        (RecordTag::TooLarge, &[id, words]) => RecordEntry::TooLarge { id, words },
        (RecordTag::Times, &[wake_ns, exec_ns, skipped]) => RecordEntry::Times {
            wake_ns,
            exec_ns,
            skipped,
        },
        _ => return None,
    })
}

/// What words of an input were as a device's input.
pub fn input_of(words: Option<&[u64; MEASUREMENT_WORDS]>) -> DeviceInput {
    DeviceInput {
        present: words.is_some(),
        measurement: words.map_or_else(Measurement::zeroed, |words| {
            bytemuck::pod_read_unaligned(bytemuck::cast_slice(words))
        }),
    }
}

fn snapshot(flags: u16, words: &[u64]) -> Option<Snapshot<'_>> {
    let &[id, cycles, reals, ints, bools, ref values @ ..] = words else {
        return None;
    };
    let (reals, values) = values.split_at_checked(usize::try_from(reals).ok()?)?;
    let (ints, values) = values.split_at_checked(usize::try_from(ints).ok()?)?;
    let (bools, motions) = values.split_at_checked(usize::try_from(bools).ok()?)?;
    Some(Snapshot {
        id,
        cycles,
        cancel: flags & CANCEL != 0,
        reals,
        ints,
        bools,
        motions,
    })
}
