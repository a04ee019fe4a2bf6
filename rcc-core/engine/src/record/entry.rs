//! Records of the flight recorder's ring: one after the other, each with a head word that gives its type and length.
//! Written by the real-time thread, read by replay, which does not trust them.

use bytemuck::Zeroable;
use rcc_core::frame::{ArmMotion, DeviceInput};
use rcc_core::message::{FaultCode, FaultRecord, JOINTS_MAX, Measurement};
use rcc_protocol::rules::RuleState;

use super::rule_entry::{self, RecordedRule};
use crate::net::Evaluation;
use crate::rule_set::RuleSet;
pub use crate::snapshot::NetSnapshot;

/// Words of a [`Measurement`].
pub const MEASUREMENT_WORDS: usize = size_of::<Measurement>() / 8;

/// Type of a record, in the lowest byte of its head.
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
    Rule = 10,
    RulesJudged = 11,
    RuleEnded = 12,
    Arm = 13,
}

const RECORD_TAGS: [RecordTag; 13] = [
    RecordTag::Cycle,
    RecordTag::Input,
    RecordTag::Request,
    RecordTag::State,
    RecordTag::Net,
    RecordTag::Snapshot,
    RecordTag::TooLarge,
    RecordTag::Times,
    RecordTag::Set,
    RecordTag::Rule,
    RecordTag::RulesJudged,
    RecordTag::RuleEnded,
    RecordTag::Arm,
];

/// Head of a record: type, a small number, flags, and how many words follow.
pub(super) const fn head(tag: RecordTag, small: u8, flags: u16, words: usize) -> u64 {
    tag as u64 | (small as u64) << 8 | (flags as u64) << 16 | (words as u64) << 32
}

/// Returns true for the head of a cycle record; its number follows.
pub(crate) fn is_cycle(head: u64) -> bool {
    head as u8 == RecordTag::Cycle as u8
}

/// Returns true for the head of an evaluation or snapshot of a net; its id follows.
pub(crate) fn is_of_net(head: u64) -> bool {
    [
        RecordTag::Net as u8,
        RecordTag::Snapshot as u8,
        RecordTag::TooLarge as u8,
    ]
    .contains(&(head as u8))
}

/// Flag of an evaluation: it started from the initial state.
pub(super) const BEGINS: u16 = 1;
/// Flag of an evaluation or snapshot: CANCEL was requested.
pub(super) const CANCEL: u16 = 2;

/// Flags of an evaluation that give how often the net was prepared again: only evaluations of the net whose plan the
/// incident contains can be compared.
pub(super) fn prepared_again_flags(prepared_again: u8) -> u16 {
    u16::from(prepared_again) << 8
}

/// Type of a request in the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum RequestKind {
    /// Second half of LOAD.
    Install = 2,
    /// A LOAD that failed.
    Reject = 3,
    /// START.
    Start = 4,
    /// CANCEL.
    Cancel = 5,
    /// ABORT.
    Abort = 6,
    /// UNLOAD.
    Unload = 7,
    /// A driver's board was attached.
    Attach = 8,
    /// A driver's board was detached.
    Detach = 9,
    /// An incident was requested.
    Record = 10,
    /// Anything else; its effects are in the records of states.
    Other = 11,
    /// Values were set.
    Set = 12,
    /// Values were read.
    Read = 13,
    /// A net was prepared again.
    Renew = 14,
    /// Rules were installed.
    InstallRules = 15,
    /// A rule was removed.
    RemoveRule = 16,
    /// A lease was granted, renewed, ended, or commands were bound to it.
    Lease = 17,
}

/// Result of an evaluation as a number.
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

/// One record as read.
#[derive(Clone, Copy, Debug)]
pub enum RecordEntry<'a> {
    /// A cycle begins.
    Cycle {
        /// Number of the cycle.
        cycle: u64,
        /// CLOCK_MONOTONIC at which it woke.
        woke_ns: u64,
    },
    /// Input of a device from this cycle on.
    Input {
        /// Index of the device.
        device: usize,
        /// Its `Measurement` as the nets see it; `None` if the device is not present.
        words: Option<&'a [u64; MEASUREMENT_WORDS]>,
    },
    /// A request was executed or refused.
    Request {
        /// [`RequestKind`].
        kind: u8,
        /// Id of the command, or index of the device.
        id: u64,
    },
    /// A command changed its state.
    State {
        /// Id of the command.
        id: u64,
        /// `CommandState`.
        state: u32,
        /// `EndReason`.
        reason: u32,
        /// The fault, if the reason is one.
        fault: FaultRecord,
    },
    /// A net was evaluated.
    Net {
        /// Its id.
        id: u64,
        /// It started from the initial state.
        begins: bool,
        /// CANCEL was requested.
        cancel: bool,
        /// How often it was prepared again, see [`crate::net::StartConditions::prepared_again`].
        prepared_again: u8,
        /// Result of the evaluation.
        evaluation: Evaluation,
        /// The engine's period, s.
        dt_s: f64,
        /// Number of its evaluations, including this one.
        cycles: u64,
        /// Hash of all its slots after the evaluation.
        hash: u64,
    },
    /// A value from outside, which the following evaluation sees.
    Set {
        /// Id of the net.
        id: u64,
        /// Index of the input in the plan.
        input: u32,
        /// Its elements.
        words: &'a [u64],
        /// Number of evaluations of the net that the value missed, because the net started later.
        late: u16,
    },
    /// The motion of an arm that the following evaluation, the first one of its net, takes over.
    Arm {
        /// Id of the net.
        id: u64,
        /// Index of the device.
        device: usize,
        /// The motion.
        motion: ArmMotion,
    },
    /// A rule that is armed, and what it sees of its commands.
    Rule(RecordedRule<'a>),
    /// The conditions of all armed rules were judged.
    RulesJudged {
        /// Rows of the rules that were judged.
        judged: RuleSet,
        /// Rows of those whose condition held.
        held: RuleSet,
    },
    /// A rule fired, was refused, expired or was disarmed.
    RuleEnded {
        /// Row of the table of rules.
        slot: usize,
        /// Id of the rule.
        id: u64,
        /// Its state.
        state: RuleState,
    },
    /// The state of a net after its evaluation in this cycle.
    Snapshot(NetSnapshot<'a>),
    /// A snapshot that is too large for the ring.
    TooLarge {
        /// Id of the net.
        id: u64,
        /// Words that it would need.
        words: u64,
    },
    /// Timing of a cycle.
    Times {
        /// How late it woke, ns.
        wake_ns: u64,
        /// Duration of its computation, ns.
        exec_ns: u64,
        /// Number of periods skipped after it.
        skipped: u64,
    },
}

/// Words that are not a valid record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown record at word {at} of the recording: replay it with the build that recorded it")]
pub struct UnknownRecord {
    /// Index of the word.
    pub at: usize,
}

/// Iterates over the records of a ring.
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
        (RecordTag::Arm, &[id, ref words @ ..]) => RecordEntry::Arm {
            id,
            device: usize::from(small),
            motion: arm_motion(words)?,
        },
        (RecordTag::Rule, words) => RecordEntry::Rule(rule_entry::read(small, words)?),
        (RecordTag::RulesJudged, words) => {
            let (judged, held) = words.split_at_checked(words.len() / 2)?;
            RecordEntry::RulesJudged {
                judged: judged.try_into().ok()?,
                held: held.try_into().ok()?,
            }
        }
        (RecordTag::RuleEnded, &[id, state]) => RecordEntry::RuleEnded {
            slot: usize::from(small),
            id,
            state: RuleState::ALL.get(usize::try_from(state).ok()?)?.0,
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

fn arm_motion(words: &[u64]) -> Option<ArmMotion> {
    let (parts, rest) = words.as_chunks::<JOINTS_MAX>();
    let &[position, velocity, acceleration] = parts else {
        return None;
    };
    rest.is_empty().then(|| ArmMotion {
        position: position.map(f64::from_bits),
        velocity: velocity.map(f64::from_bits),
        acceleration: acceleration.map(f64::from_bits),
    })
}

/// Converts the words of an input record to a device input.
pub fn input_of(words: Option<&[u64; MEASUREMENT_WORDS]>) -> DeviceInput {
    DeviceInput {
        present: words.is_some(),
        measurement: words.map_or_else(Measurement::zeroed, |words| {
            bytemuck::pod_read_unaligned(bytemuck::cast_slice(words))
        }),
    }
}

fn snapshot(flags: u16, words: &[u64]) -> Option<NetSnapshot<'_>> {
    let &[id, cycles, reals, ints, bools, ref values @ ..] = words else {
        return None;
    };
    let (reals, values) = values.split_at_checked(usize::try_from(reals).ok()?)?;
    let (ints, values) = values.split_at_checked(usize::try_from(ints).ok()?)?;
    let (bools, motions) = values.split_at_checked(usize::try_from(bools).ok()?)?;
    Some(NetSnapshot {
        id,
        cycles,
        cancel: flags & CANCEL != 0,
        reals,
        ints,
        bools,
        motions,
    })
}
