//! Replay: rebuilds the nets of a recording from their plans, evaluates them on the recorded inputs, and compares the
//! hash of all their slots in every cycle. Run off-line in virtual time; a recording may come from anywhere, so nothing
//! in it is trusted.

mod rules;

use std::collections::BTreeMap;

use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::primitive::{Operand, Sizes};
use rcc_core::primitives;
use rcc_core::types::Store;

use rcc_protocol::control::Refusal;

use crate::hash::real_word;
use crate::net::{Evaluation, Net, NetOrigin};
use crate::record::entry::RequestKind;
use crate::record::entry::{NetSnapshot, RecordEntries, RecordEntry, UnknownRecord, input_of};
use rules::RuleReplay;
pub use rules::RuleReplayResult;

/// The recording to be replayed.
#[derive(Clone, Copy, Debug)]
pub struct ReplaySource<'a> {
    /// The devices.
    pub models: &'a [DeviceModel],
    /// Fingerprint of the configuration for which the plans were made.
    pub configuration: u64,
    /// The nets by id.
    pub nets: &'a BTreeMap<u64, NetOrigin>,
    /// The records, as words.
    pub words: &'a [u64],
}

/// Why a recording cannot be replayed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// The recording is damaged.
    #[error(transparent)]
    UnknownRecord(#[from] UnknownRecord),
    /// A net cannot be evaluated by this build.
    #[error(
        "the plan of net {id} is not valid for this build ({error:?}): replay it with the build that recorded it"
    )]
    Plan {
        /// Id of the net.
        id: u64,
        /// Reason.
        error: Refusal,
    },
    /// The recording has an input of a device that the cell does not have.
    #[error("cycle {cycle} has an input of device {device}, but the cell has no such device")]
    NoDevice {
        /// The cycle.
        cycle: u64,
        /// Index of the device.
        device: usize,
    },
}

/// The first difference between a replayed net and the recorded one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mismatch {
    /// Executor cycle.
    pub cycle: u64,
    /// Evaluation of the net, counted from 1.
    pub net_cycle: u64,
    /// Kind of the difference.
    pub what: MismatchKind,
    /// The first slot that differs, if a later snapshot shows it.
    pub slot: Option<SlotDifference>,
}

/// Kind of a difference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MismatchKind {
    /// At least one slot.
    Slots,
    /// The result of the evaluation.
    Evaluation {
        /// In the recording.
        recorded: Evaluation,
        /// In the replay.
        replayed: Evaluation,
    },
    /// The number of evaluations: records are missing.
    Cycles {
        /// In the recording.
        recorded: u64,
        /// In the replay.
        replayed: u64,
    },
}

/// A slot that differs at a snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotDifference {
    /// Executor cycle of the snapshot.
    pub cycle: u64,
    /// Arena of the slot.
    pub store: Store,
    /// Index of the slot.
    pub slot: u32,
    /// Type of the primitive that writes it, the first one in evaluation order that wrote a different value; `None` if
    /// a delayed link writes it, or nothing does.
    pub writer: Option<&'static str>,
    /// Bits of the recorded value.
    pub recorded: u64,
    /// Bits of the replayed value.
    pub replayed: u64,
}

/// Result of the replay of one net.
#[derive(Clone, Debug, PartialEq)]
pub struct NetReplayResult {
    /// Id of the net.
    pub id: u64,
    /// Number of recorded evaluations.
    pub recorded: u64,
    /// Number of evaluations that were compared.
    pub compared: u64,
    /// Number of compared evaluations that differ.
    pub different: u64,
    /// First and last executor cycle that was compared; 0: none.
    pub span: [u64; 2],
    /// The first difference.
    pub mismatch: Option<Mismatch>,
    /// The recording contains its plan.
    pub has_plan: bool,
    /// Words of a snapshot that was too large for the ring; 0: none was.
    pub too_large: u64,
}

/// One evaluation in a replay.
#[derive(Clone, Copy, Debug)]
pub struct ReplayStep<'a> {
    /// Executor cycle.
    pub cycle: u64,
    /// CLOCK_MONOTONIC at which it woke.
    pub woke_ns: u64,
    /// Id of the net.
    pub id: u64,
    /// The net after the evaluation.
    pub net: &'a Net,
    /// Equal to the recorded evaluation.
    pub same: bool,
}

struct NetReplay {
    net: Option<Box<Net>>,
    /// The state of the net is a recorded one, or follows from one.
    known: bool,
    result: NetReplayResult,
}

/// Replays all records up to and including cycle `until`, and passes each evaluation to `watch`.
///
/// # Errors
/// Returns [`ReplayError`] if the recording cannot be read, or this build cannot evaluate its nets.
pub fn replay(
    source: &ReplaySource<'_>,
    until: Option<u64>,
    watch: impl FnMut(ReplayStep<'_>),
) -> Result<Vec<NetReplayResult>, ReplayError> {
    Ok(replay_with_rules(source, until, watch)?.0)
}

/// As [`replay`]; also judges the conditions of all rules again.
///
/// # Errors
/// As for [`replay`].
pub fn replay_with_rules(
    source: &ReplaySource<'_>,
    until: Option<u64>,
    mut watch: impl FnMut(ReplayStep<'_>),
) -> Result<(Vec<NetReplayResult>, RuleReplayResult), ReplayError> {
    let mut rules = RuleReplay::default();
    let absent = input_of(None);
    let mut inputs: Vec<DeviceInput> = vec![absent; source.models.len()];
    let mut net_replays: BTreeMap<u64, NetReplay> = BTreeMap::new();
    let (mut cycle, mut woke_ns) = (0, 0);
    for entry in RecordEntries::new(source.words) {
        match entry? {
            RecordEntry::Cycle { cycle: next, .. } if until.is_some_and(|until| next > until) => {
                break;
            }
            RecordEntry::Cycle {
                cycle: next,
                woke_ns: at,
            } => (cycle, woke_ns) = (next, at),
            RecordEntry::Input { device, words } => {
                let place = inputs.get_mut(device);
                *place.ok_or(ReplayError::NoDevice { cycle, device })? = input_of(words);
            }
            entry @ RecordEntry::Net { id, .. } => {
                let net_replay = net_replay_of(&mut net_replays, source, id)?;
                let same = net_replay.evaluate(source, &inputs, cycle, &entry);
                if let RecordEntry::Net { evaluation, .. } = entry {
                    let net = net_replay.net.as_ref().filter(|_| same.is_some());
                    let outcome = net.map(|net| net.outcome);
                    rules.evaluated(id, evaluation, outcome);
                }
                if let (Some(same), Some(net)) = (same, &net_replay.net) {
                    watch(ReplayStep {
                        cycle,
                        woke_ns,
                        id,
                        net,
                        same,
                    });
                }
            }
            RecordEntry::Set {
                id,
                input,
                words,
                late,
            } => {
                if let Some(net) = &mut net_replay_of(&mut net_replays, source, id)?.net {
                    net.inputs_mut().stage_value(input, words, late);
                }
            }
            RecordEntry::Snapshot(snapshot) => {
                net_replay_of(&mut net_replays, source, snapshot.id)?
                    .compare_with_snapshot(&snapshot, cycle);
            }
            RecordEntry::TooLarge { id, words } => {
                net_replay_of(&mut net_replays, source, id)?
                    .result
                    .too_large = words;
            }
            RecordEntry::State {
                id, state, reason, ..
            } => rules.state(id, state, reason),
            RecordEntry::Request { kind, id } if kind == RequestKind::Unload as u8 => {
                rules.unload(id);
            }
            RecordEntry::Arm { id, device, motion } => {
                if let Some(net) = &mut net_replay_of(&mut net_replays, source, id)?.net {
                    net.take_arm(device, motion);
                }
            }
            RecordEntry::Rule(recorded) => rules.define(recorded),
            RecordEntry::RulesJudged { judged, held } => {
                rules.compare(cycle, &net_replays, judged, held);
            }
            RecordEntry::RuleEnded { slot, id, state } => rules.end(cycle, slot, id, state),
            RecordEntry::Request { .. } | RecordEntry::Times { .. } => {}
        }
    }
    let results = net_replays
        .into_values()
        .map(|net_replay| net_replay.result);
    Ok((results.collect(), rules.result))
}

fn net_replay_of<'t>(
    net_replays: &'t mut BTreeMap<u64, NetReplay>,
    source: &ReplaySource<'_>,
    id: u64,
) -> Result<&'t mut NetReplay, ReplayError> {
    use std::collections::btree_map::Entry as Place;
    let place = match net_replays.entry(id) {
        Place::Occupied(place) => return Ok(place.into_mut()),
        Place::Vacant(place) => place,
    };
    let net = match source.nets.get(&id) {
        None => None,
        Some(origin) => {
            let net = Net::rebuild(origin, source.models, source.configuration);
            Some(net.map_err(|error| ReplayError::Plan { id, error })?)
        }
    };
    let result = NetReplayResult {
        id,
        recorded: 0,
        compared: 0,
        different: 0,
        span: [0; 2],
        mismatch: None,
        has_plan: net.is_some(),
        too_large: 0,
    };
    Ok(place.insert(NetReplay {
        net,
        known: false,
        result,
    }))
}

impl NetReplay {
    /// Evaluates and compares; `None` while the state is not known.
    fn evaluate(
        &mut self,
        source: &ReplaySource<'_>,
        inputs: &[DeviceInput],
        cycle: u64,
        entry: &RecordEntry<'_>,
    ) -> Option<bool> {
        let &RecordEntry::Net {
            begins,
            cancel,
            prepared_again,
            evaluation,
            dt_s,
            cycles,
            hash: recorded,
            ..
        } = entry
        else {
            return None;
        };
        self.result.recorded += 1;
        let net = self.net.as_mut()?;
        if prepared_again != net.prepared_again() {
            // A START that was refused, before the net was prepared again; values that it took are recorded again when
            // the next evaluation takes them.
            net.inputs_mut().discard_staged();
            return None;
        }
        if begins {
            net.begin_again();
            self.known = true;
        }
        if !self.known {
            net.inputs_mut().discard_staged();
            return None;
        }
        net.cancel_requested = cancel;
        let replayed = net.evaluate(source.models, inputs, dt_s);
        let different = if replayed != evaluation {
            let recorded = evaluation;
            Some(MismatchKind::Evaluation { recorded, replayed })
        } else if net.cycles != cycles {
            let (recorded, replayed) = (cycles, net.cycles);
            Some(MismatchKind::Cycles { recorded, replayed })
        } else {
            (net.hash() != recorded).then_some(MismatchKind::Slots)
        };
        let result = &mut self.result;
        result.compared += 1;
        let [first, last] = &mut result.span;
        *first = if *first == 0 { cycle } else { *first };
        *last = cycle;
        if let Some(what) = different {
            result.different += 1;
            result.mismatch.get_or_insert(Mismatch {
                cycle,
                net_cycle: cycles,
                what,
                slot: None,
            });
        }
        Some(different.is_none())
    }

    /// At a snapshot: locates the first difference, if there was one, and continues from the recorded state.
    fn compare_with_snapshot(&mut self, snapshot: &NetSnapshot<'_>, cycle: u64) {
        let Some(net) = &mut self.net else { return };
        if let Some(mismatch) = &mut self.result.mismatch
            && mismatch.slot.is_none()
            && self.known
        {
            mismatch.slot =
                first_difference(net, snapshot).map(|slot| SlotDifference { cycle, ..slot });
        }
        self.known |= net.restore(snapshot).is_some();
    }
}

/// The first slot that differs, in evaluation order.
fn first_difference(net: &Net, snapshot: &NetSnapshot<'_>) -> Option<SlotDifference> {
    let origin = net.origin();
    let plan = origin.data.plan();
    for run in plan.runs {
        let (entry, kernel) = primitives::kernel(run.kernel)?;
        let group = entry.spec.operands(kernel).count().max(1);
        let list = entry.spec.sizes(kernel);
        for operands in plan.operands_of(run)?.chunks_exact(group) {
            let sizes = Sizes::read(&list, operands);
            for (operand, &slot) in entry.spec.operands(kernel).zip(operands) {
                let Operand::Slot {
                    store,
                    width,
                    written: true,
                } = operand
                else {
                    continue;
                };
                let found = (slot..slot + sizes.width(width))
                    .find_map(|slot| differs(net, snapshot, store, slot));
                if let Some(found) = found {
                    let writer = Some(entry.spec.name);
                    return Some(SlotDifference { writer, ..found });
                }
            }
        }
    }
    let (reals, bools, ints) = net.arenas();
    let arenas = [
        (Store::Real, reals.len()),
        (Store::Bool, bools.len()),
        (Store::Int, ints.len()),
    ];
    let all = arenas
        .into_iter()
        .flat_map(|(store, count)| (0..count as u32).map(move |slot| (store, slot)));
    all.into_iter()
        .find_map(|(store, slot)| differs(net, snapshot, store, slot))
}

fn differs(
    net: &Net,
    snapshot: &NetSnapshot<'_>,
    store: Store,
    slot: u32,
) -> Option<SlotDifference> {
    let (reals, bools, ints) = net.arenas();
    let index = slot as usize;
    let (recorded, replayed) = match store {
        Store::Real => {
            let recorded = *snapshot.reals.get(index)?;
            (real_word(recorded), real_word(reals.get(index)?.to_bits()))
        }
        Store::Int => (*snapshot.ints.get(index)?, ints.get(index)?.cast_unsigned()),
        Store::Bool => {
            let bytes = snapshot.bools.get(index / 8)?.to_le_bytes();
            (
                u64::from(*bytes.get(index % 8)?),
                u64::from(*bools.get(index)?),
            )
        }
    };
    (recorded != replayed).then_some(SlotDifference {
        cycle: 0,
        store,
        slot,
        writer: None,
        recorded,
        replayed,
    })
}
