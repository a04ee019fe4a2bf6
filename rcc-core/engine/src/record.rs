//! Flight recorder: always on, it keeps the last seconds of everything that replay needs. Owned by the real-time
//! thread, which writes words into preallocated memory. A frozen ring is handed to a helper thread and replaced by
//! another one, so that a file can be written while recording continues.
//!
//! Cost: two copies of a few words per cycle, one of about 70 words for each device with a new measurement, one of five
//! words for each net and the hash of its slots, one of three words and the elements for each value from outside or
//! from another net; at most one snapshot of a net per cycle, each net about once a second.

pub mod entry;
pub mod ring;
pub mod rule_entry;

use rcc_core::frame::{ArmMotion, DeviceInput};
use rcc_core::message::{
    COMMANDS_MAX, CommandState, DEVICES_MAX, EndReason, FaultRecord, JOINTS_MAX,
};
use rcc_protocol::rules::{RULE_TERMS_MAX, Rule, RuleStatus};
use rtrb::{Consumer, Producer};

use crate::boards::DeviceBoards;
use crate::hash;
use crate::net::{Evaluation, Net};
use crate::queue::EngineRequest;
use crate::rows::{RowIndex, RowSet, set_bits};
use crate::rule_set::RuleSet;
use entry::{
    BEGINS, CANCEL, MEASUREMENT_WORDS, RecordTag, RequestKind, head, outcome_number,
    prepared_again_flags,
};
use ring::RecordRing;
use rule_entry::TERM_WORDS;

/// Time for which recording continues after a trigger, ns.
pub const POST_TRIGGER_NS: u64 = 200_000_000;
/// Faults within this time after an incident are delayed and share one file, ns, so that a burst of faults does not
/// fill the disk. Shorter if the ring would overwrite the first of them.
pub const HOLD_OFF_NS: u64 = 5_000_000_000;
/// Approximate period of the snapshots of each net, ns.
const SNAPSHOT_EVERY_NS: u64 = 1_000_000_000;

/// Sizes of the recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlightRecorderConfig {
    /// Longest recorded time, ns.
    pub span_ns: u64,
    /// Memory of both rings together, bytes.
    pub memory: usize,
    /// Base period of the engine, ns.
    pub period_ns: u64,
}

/// Why a recording was frozen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TriggerReason {
    /// A net ended with a fault.
    Fault {
        /// Id of the net.
        id: u64,
        /// The fault.
        fault: FaultRecord,
    },
    /// Too many consecutive late cycles.
    Late,
    /// Requested by a client.
    Request,
    /// The condition of a rule that records became true.
    Rule {
        /// Id of the rule.
        id: u64,
    },
}

/// Reason and cycle at which a recording was frozen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trigger {
    /// Reason.
    pub reason: TriggerReason,
    /// Cycle of the trigger.
    pub cycle: u64,
    /// CLOCK_MONOTONIC of that cycle.
    pub stamp_ns: u64,
    /// Number of further triggers before the recording was handed over.
    pub others: u64,
}

/// A frozen recording.
#[derive(Debug)]
pub struct FrozenRecording {
    /// The records.
    pub ring: Box<RecordRing>,
    /// Why it was frozen.
    pub trigger: Trigger,
}

/// The helper thread's ends: receives recordings, returns their rings.
#[derive(Debug)]
pub struct FlightRecorderHelper {
    /// Receives frozen recordings.
    pub recordings: Consumer<FrozenRecording>,
    /// Returns rings whose recording was written to disk.
    pub spare: Producer<Box<RecordRing>>,
}

#[derive(Debug)]
struct PendingTrigger {
    trigger: Trigger,
    due_cycle: u64,
    /// Number of words written to the ring after which it is due in any case: the trigger would soon be overwritten.
    due_written: u64,
}

/// The flight recorder's part on the real-time thread.
#[derive(Debug)]
pub struct FlightRecorder {
    ring: Box<RecordRing>,
    spare: Option<Box<RecordRing>>,
    recordings: Producer<FrozenRecording>,
    spares: Consumer<Box<RecordRing>>,
    /// Bit d: device d is recorded.
    devices: u64,
    /// Bit d: the input of device d was written in this cycle already.
    written: u64,
    /// Rows whose net is due for a snapshot.
    due: RowSet,
    snapshot_step: u64,
    /// Number of words written when all nets were last due.
    round_at: u64,
    snapshot_words_max: usize,
    post_cycles: u64,
    hold_off_cycles: u64,
    /// Cycles for which the ring surely contains a trigger.
    kept_cycles: u64,
    earliest_cycle: u64,
    cycle: u64,
    woke_ns: u64,
    /// A snapshot was taken in this cycle.
    snapshot_taken: bool,
    /// The ring is new: all devices are written in the next cycle.
    ring_is_new: bool,
    pending: Option<PendingTrigger>,
    handed_over: u64,
}

impl FlightRecorder {
    /// Allocates all memory. Not for the real-time thread.
    pub fn new(
        config: FlightRecorderConfig,
        devices: usize,
    ) -> (FlightRecorder, FlightRecorderHelper) {
        // The first hash detects the processor's vector instructions: here, not in a cycle.
        hash::hash(&[], &[], [0; 3]);
        let period_ns = config.period_ns.max(1);
        let cycles = usize::try_from(config.span_ns / period_ns).unwrap_or(usize::MAX);
        let words = config.memory / 2 / size_of::<u64>();
        let (recording_in, recordings) = rtrb::RingBuffer::new(2);
        let (spare, spares) = rtrb::RingBuffer::new(2);
        let ring = RecordRing::new(words, cycles);
        let recorder = FlightRecorder {
            snapshot_words_max: ring.capacity() / 8,
            kept_cycles: three_quarters(ring.cycles_max() as u64),
            spare: Some(RecordRing::new(words, cycles)),
            ring,
            recordings: recording_in,
            spares,
            devices: (0..devices.min(DEVICES_MAX)).fold(0, |bits, device| bits | 1 << device),
            written: 0,
            due: RowSet::EMPTY,
            round_at: 0,
            snapshot_step: (SNAPSHOT_EVERY_NS / period_ns / COMMANDS_MAX as u64).max(1),
            post_cycles: POST_TRIGGER_NS.div_ceil(period_ns),
            hold_off_cycles: HOLD_OFF_NS / period_ns,
            earliest_cycle: 0,
            cycle: 0,
            woke_ns: 0,
            snapshot_taken: false,
            ring_is_new: true,
            pending: None,
            handed_over: 0,
        };
        (recorder, FlightRecorderHelper { recordings, spare })
    }

    /// Begins a cycle; `inputs` are the device inputs that its nets see, of which those in `changed` (bit d: device d)
    /// are not those of the cycle before.
    pub fn begin(&mut self, cycle: u64, woke_ns: u64, (inputs, changed): (&[DeviceInput], u64)) {
        (self.cycle, self.woke_ns, self.snapshot_taken) = (cycle, woke_ns, false);
        self.ring.begin_cycle();
        self.ring
            .push(&[head(RecordTag::Cycle, 0, 0, 2), cycle, woke_ns]);
        if cycle.checked_rem(self.snapshot_step) == Some(0) {
            let row = cycle.checked_div(self.snapshot_step).unwrap_or(0);
            self.due.insert(RowIndex::wrapping(row));
        }
        // A small ring is overwritten sooner: make sure that it contains a snapshot to start from.
        let written = self.ring.written();
        if written.saturating_sub(self.round_at) > self.ring.capacity() as u64 / 4 {
            (self.due, self.round_at) = (RowSet::ALL, written);
        }
        let all = match std::mem::take(&mut self.ring_is_new) {
            true => u64::MAX,
            false => 0,
        };
        self.written = 0;
        self.write_inputs(changed | all, inputs);
    }

    /// Writes the inputs of these devices that were not yet written in this cycle.
    fn write_inputs(&mut self, devices: u64, inputs: &[DeviceInput]) {
        for index in set_bits(self.devices & devices & !self.written) {
            if let Some(input) = inputs.get(index) {
                push_input(&mut self.ring, index, input);
            }
        }
        self.written |= devices;
    }

    /// Records that a request is executed or refused in this cycle.
    pub fn request<B: DeviceBoards>(&mut self, request: &EngineRequest<B>) {
        let (kind, id) = kind_of(request);
        self.ring
            .push(&[head(RecordTag::Request, kind as u8, 0, 1), id]);
    }

    /// Records a change of state of a command; a fault triggers freezing.
    pub fn state(&mut self, id: u64, state: u32, reason: u32, fault: &FaultRecord) {
        const WORDS: usize = size_of::<FaultRecord>() / 8;
        let words: &[u64; WORDS] = bytemuck::cast_ref(fault);
        let states = u64::from(state) | u64::from(reason) << 32;
        self.ring
            .push(&[head(RecordTag::State, 0, 0, 2 + WORDS), id, states]);
        self.ring.push(words);
        if state == CommandState::Terminated as u32 && reason == EndReason::Fault as u32 {
            self.trigger(TriggerReason::Fault { id, fault: *fault });
        }
    }

    /// Records a value that the next evaluation of a net sees.
    pub fn set(&mut self, id: u64, input: u32, words: &[u64], late: u16) {
        let head = head(RecordTag::Set, 0, late, 2 + words.len());
        self.ring.push(&[head, id, u64::from(input)]);
        self.ring.push(words);
    }

    /// Records the motion of an arm that the first evaluation of a net takes over.
    pub fn arm(&mut self, id: u64, device: usize, motion: &ArmMotion) {
        let parts = [&motion.position, &motion.velocity, &motion.acceleration];
        let words = 1 + parts.len() * JOINTS_MAX;
        self.ring
            .push(&[head(RecordTag::Arm, device as u8, 0, words), id]);
        for part in parts {
            self.ring.push(bytemuck::cast_slice(part));
        }
    }

    /// Records an evaluation.
    pub fn net(&mut self, evaluated: EvaluationRecord<'_>, inputs: &[DeviceInput]) {
        let EvaluationRecord {
            row,
            id,
            net,
            evaluation,
            begins,
            cancel,
            dt_s,
        } = evaluated;
        if begins {
            // A net can be replayed from here on.
            self.write_inputs(u64::MAX, inputs);
            self.due.remove(row);
        }
        let flags = if begins { BEGINS } else { 0 } | if cancel { CANCEL } else { 0 };
        let flags = flags | prepared_again_flags(net.prepared_again());
        let outcome = outcome_number(evaluation);
        self.ring.push(&[
            head(RecordTag::Net, outcome, flags, 4),
            id,
            net.cycles,
            dt_s.to_bits(),
            net.hash(),
        ]);
        let due = self.due.contains(row) && !self.snapshot_taken;
        if due && evaluation == Evaluation::Running {
            self.due.remove(row);
            self.snapshot_taken = true;
            self.snapshot((id, net), flags & CANCEL, inputs);
        }
    }

    fn snapshot(&mut self, (id, net): (u64, &Net), flags: u16, inputs: &[DeviceInput]) {
        let (reals, bools, ints) = net.arenas();
        let packed = bools.len().div_ceil(8);
        let words = 5 + reals.len() + ints.len() + packed + net.motions().words();
        if words > self.snapshot_words_max {
            let head = head(RecordTag::TooLarge, 0, 0, 2);
            self.ring.push(&[head, id, words as u64]);
            return;
        }
        self.write_inputs(u64::MAX, inputs);
        let lengths = [reals.len() as u64, ints.len() as u64, packed as u64];
        let [reals_len, ints_len, bools_len] = lengths;
        let head = head(RecordTag::Snapshot, 0, flags, words);
        self.ring
            .push(&[head, id, net.cycles, reals_len, ints_len, bools_len]);
        self.ring.push(bytemuck::cast_slice(reals));
        self.ring.push(bytemuck::cast_slice(ints));
        for bytes in bools.chunks(8) {
            self.ring.push(&[hash::packed(bytes)]);
        }
        net.motions().save(|words| {
            self.ring.push(words);
        });
    }

    /// Records an armed rule in a row of the table, with a word of facts about the command of each term.
    pub fn rule(&mut self, slot: usize, id: u64, rule: &Rule, facts: &[u64; RULE_TERMS_MAX]) {
        let words = 1 + rule.terms().count() * TERM_WORDS;
        let head = head(RecordTag::Rule, slot as u8, 0, words);
        let ring = &mut self.ring;
        ring.push(&[head, id]);
        rule_entry::push_terms(rule, facts, |words| {
            ring.push(&words);
        });
    }

    /// Records which rules were judged in this cycle, and which conditions held.
    pub fn rules_judged(&mut self, judged: RuleSet, held: RuleSet) {
        let words = judged.len() + held.len();
        self.ring.push(&[head(RecordTag::RulesJudged, 0, 0, words)]);
        self.ring.push(&judged);
        self.ring.push(&held);
    }

    /// Records that a rule can no longer fire.
    pub fn rule_ended(&mut self, slot: usize, status: &RuleStatus) {
        let head = head(RecordTag::RuleEnded, slot as u8, 0, 2);
        self.ring.push(&[head, status.id, status.state as u64]);
    }

    /// Freezes the recording after [`POST_TRIGGER_NS`], or later within the hold-off time, but before the ring overwrites
    /// the trigger: when it fills three quarters of the ring at the latest.
    pub fn trigger(&mut self, reason: TriggerReason) {
        let after = self.cycle + self.post_cycles;
        let due_cycle = match reason {
            TriggerReason::Request => after,
            _ => after.max(self.earliest_cycle),
        };
        let due_cycle = due_cycle.min(self.cycle + self.kept_cycles);
        if let Some(pending) = &mut self.pending {
            pending.trigger.others += 1;
            pending.due_cycle = pending.due_cycle.min(due_cycle);
            return;
        }
        let trigger = Trigger {
            reason,
            cycle: self.cycle,
            stamp_ns: self.woke_ns,
            others: 0,
        };
        let kept_words = three_quarters(self.ring.capacity() as u64);
        self.pending = Some(PendingTrigger {
            trigger,
            due_cycle,
            due_written: self.ring.written().saturating_add(kept_words),
        });
    }

    /// Ends a cycle with its timing (ns, skipped periods); swaps the rings if a frozen recording is due.
    pub fn end(&mut self, wake_ns: u64, exec_ns: u64, skipped: u64) {
        let head = head(RecordTag::Times, 0, 0, 3);
        self.ring.push(&[head, wake_ns, exec_ns, skipped]);
        if self.spare.is_none() {
            self.spare = self.spares.pop().ok();
        }
        let (cycle, written) = (self.cycle, self.ring.written());
        let is_due =
            |pending: &PendingTrigger| cycle >= pending.due_cycle || written >= pending.due_written;
        if self.pending.as_ref().is_some_and(is_due) {
            self.hand_over();
        }
    }

    /// Returns the number of recordings that were handed over.
    pub fn handed_over(&self) -> u64 {
        self.handed_over
    }

    /// Hands over a frozen recording if there is one and a spare ring; otherwise it waits for one.
    pub fn hand_over(&mut self) {
        // Check everything before moving anything: a ring that does not fit could only be freed here.
        if self.recordings.is_full() || self.spare.is_none() {
            return;
        }
        let Some(pending) = self.pending.take() else {
            return;
        };
        let Some(spare) = self.spare.take() else {
            return;
        };
        let ring = std::mem::replace(&mut self.ring, spare);
        let trigger = pending.trigger;
        let full = self.recordings.push(FrozenRecording { ring, trigger });
        if let Err(rtrb::PushError::Full(recording)) = full {
            // Unreachable: there was room.
            self.spare = Some(recording.ring);
        }
        self.handed_over += 1;
        self.earliest_cycle = self.cycle + self.hold_off_cycles;
        (self.due, self.round_at, self.ring_is_new) = (RowSet::ALL, 0, true);
    }
}

fn three_quarters(count: u64) -> u64 {
    count - count / 4
}

/// An evaluation of a net, as recorded.
#[derive(Clone, Copy, Debug)]
pub struct EvaluationRecord<'a> {
    /// Row of the command table.
    pub row: RowIndex,
    /// Id of the command.
    pub id: u64,
    /// The net after the evaluation.
    pub net: &'a Net,
    /// Result of the evaluation.
    pub evaluation: Evaluation,
    /// The evaluation started from the initial state.
    pub begins: bool,
    /// CANCEL was requested before it.
    pub cancel: bool,
    /// The engine's period, s.
    pub dt_s: f64,
}

fn push_input(ring: &mut RecordRing, index: usize, input: &DeviceInput) {
    let index = index as u8;
    if input.present {
        let words: &[u64; MEASUREMENT_WORDS] = bytemuck::cast_ref(&input.measurement);
        ring.push(&[head(RecordTag::Input, index, 0, MEASUREMENT_WORDS)]);
        ring.push(words);
    } else {
        ring.push(&[head(RecordTag::Input, index, 0, 0)]);
    }
}

fn kind_of<B: DeviceBoards>(request: &EngineRequest<B>) -> (RequestKind, u64) {
    match request {
        EngineRequest::Install { id, .. } => (RequestKind::Install, *id),
        EngineRequest::Renew { id, .. } => (RequestKind::Renew, *id),
        EngineRequest::Reject { id, .. } => (RequestKind::Reject, *id),
        EngineRequest::Start { id, .. } => (RequestKind::Start, *id),
        EngineRequest::Cancel { id, .. } => (RequestKind::Cancel, *id),
        EngineRequest::Abort { id, .. } => (RequestKind::Abort, *id),
        EngineRequest::Unload { id, .. } => (RequestKind::Unload, *id),
        EngineRequest::Attach { device, .. } => (RequestKind::Attach, *device as u64),
        EngineRequest::Detach { device, .. } => (RequestKind::Detach, *device as u64),
        EngineRequest::Set { id, .. } => (RequestKind::Set, *id),
        EngineRequest::Read { id, .. } => (RequestKind::Read, *id),
        EngineRequest::Record { .. } => (RequestKind::Record, 0),
        EngineRequest::InstallRules { .. } => (RequestKind::InstallRules, 0),
        EngineRequest::RemoveRule { id, .. } => (RequestKind::RemoveRule, *id),
        EngineRequest::GrantLease { .. } => (RequestKind::Lease, 0),
        EngineRequest::RenewLease { lease, .. }
        | EngineRequest::EndLease { lease, .. }
        | EngineRequest::BindLease { lease, .. } => (RequestKind::Lease, *lease),
        _ => (RequestKind::Other, 0),
    }
}
