//! Values from outside a net: set by clients and checked, or copied from another net. They are staged between two
//! cycles and written into the net's slots at its next evaluation. Run by the real-time thread; all memory is allocated
//! with the net.

use rcc_core::plan::{InputPoint, Plan};
use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};
use rcc_protocol::control::{InputFault, InputValue, Refusal};

use crate::rows::RowIndex;

/// The arenas of a net.
#[derive(Debug)]
pub struct ArenaSlices<'a> {
    /// `Real`.
    pub reals: &'a mut [f64],
    /// `Bool`.
    pub bools: &'a mut [u8],
    /// `Int`.
    pub ints: &'a mut [i64],
}

/// The staged values for the inputs of a net.
#[derive(Debug)]
pub struct NetInputs {
    buffers: Box<[InputBuffer]>,
    words: Box<[u64]>,
    /// Version of the published topics for which [`NetInputs::bind`] was called last.
    bound: u64,
}

#[derive(Clone, Copy, Debug)]
struct InputBuffer {
    first: usize,
    width: usize,
    staged: StagedValue,
    source: Option<TopicSource>,
    /// Cycle in which `source` computed the value that was copied last.
    source_cycle: Option<u64>,
    /// The last value came from another net that was running.
    from_topic: bool,
    /// Number of evaluations of this net that the staged value missed, because the net started later.
    late: u16,
}

/// The value of another net that an input subscribes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicSource {
    /// Row of the publishing net.
    pub row: RowIndex,
    /// Index in the list of values that the net publishes.
    pub publish: usize,
}

/// A net that publishes values.
pub trait Publisher {
    /// Executor's cycle of its last evaluation.
    fn evaluated_cycle(&self) -> u64;
    /// Copies a published value to another net. It becomes null if width or type of slot differ, which happens if a
    /// plan declares wrong types.
    fn copy_published(&self, publish: usize, to: &InputPoint, room: &mut [u64]);
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StagedValue {
    Nothing,
    /// Staged for the next evaluation.
    Waiting,
    /// Taken by the first evaluation; staged again if START is refused.
    TakenFirst,
}

impl NetInputs {
    /// Allocates room for the inputs of a checked plan. Not for the real-time thread.
    pub fn of(points: &[InputPoint]) -> NetInputs {
        let mut first = 0;
        let place = |point: &InputPoint| {
            let width = point.width as usize;
            first += width;
            InputBuffer {
                first: first - width,
                width,
                staged: StagedValue::Nothing,
                source: None,
                source_cycle: None,
                from_topic: false,
                late: 0,
            }
        };
        let buffers = points.iter().map(place).collect();
        NetInputs {
            buffers,
            words: vec![0; first].into(),
            bound: 0,
        }
    }

    /// Looks up the sources of all topics again if `version`, the version of the published topics, has changed.
    pub fn bind(
        &mut self,
        points: &[InputPoint],
        version: u64,
        find: impl Fn(&InputPoint) -> Option<TopicSource>,
    ) {
        if std::mem::replace(&mut self.bound, version) == version {
            return;
        }
        for (place, point) in self.buffers.iter_mut().zip(points) {
            let source = find(point);
            if place.source != source {
                (place.source, place.source_cycle) = (source, None);
            }
        }
    }

    /// Stages the values that other nets have computed since the last call, and null for topics that no net publishes
    /// any more. `cycle` is the executor's cycle, `every` the number of cycles between two evaluations of this net;
    /// `net_in` returns the net in a row.
    pub fn receive<'n, P: Publisher + 'n>(
        &mut self,
        points: &[InputPoint],
        (cycle, every): (u64, u32),
        net_in: impl Fn(RowIndex) -> Option<&'n P>,
    ) {
        let buffers = self.buffers.iter_mut().zip(points);
        for (place, point) in buffers.filter(|(_, point)| point.topic.is_some()) {
            let Some(room) = self.words.get_mut(place.first..place.first + place.width) else {
                continue;
            };
            let source = place.source;
            let net = source.and_then(|source| Some((net_in(source.row)?, source.publish)));
            match net {
                Some((net, _)) if place.source_cycle == Some(net.evaluated_cycle()) => continue,
                Some((net, publish)) => {
                    net.copy_published(publish, point, room);
                    (place.source_cycle, place.from_topic) = (Some(net.evaluated_cycle()), true);
                    let since = cycle.saturating_sub(net.evaluated_cycle() + 1);
                    let late = since.checked_div(u64::from(every)).unwrap_or(0);
                    place.late = u16::try_from(late).unwrap_or(u16::MAX);
                }
                None if place.from_topic => {
                    room.fill(null(point.store));
                    (place.from_topic, place.late) = (false, 0);
                }
                None => continue,
            }
            place.staged = StagedValue::Waiting;
        }
    }

    /// Stages all values, or none of them. Bounds are constants of the plan.
    ///
    /// # Errors
    /// Returns [`Refusal::Input`] for the first value that cannot be set.
    pub fn set(&mut self, plan: &Plan<'_>, values: &[InputValue]) -> Result<(), Refusal> {
        for (index, value) in values.iter().enumerate() {
            let twice = values
                .iter()
                .take(index)
                .any(|other| other.input == value.input);
            let fault = if twice {
                Err(InputFault::Twice)
            } else {
                check(plan, value)
            };
            let input = value.input;
            fault.map_err(|fault| Refusal::Input { input, fault })?;
        }
        for value in values {
            self.stage_value(value.input, &value.words, 0);
        }
        Ok(())
    }

    /// Stages one value that was checked before; ignores words of the wrong number. `late` is the number of evaluations
    /// of the net that the value missed.
    pub fn stage_value(&mut self, input: u32, words: &[u64], late: u16) {
        let Some(place) = self.buffers.get_mut(input as usize) else {
            return;
        };
        let room = self.words.get_mut(place.first..place.first + place.width);
        if let Some(room) = room.filter(|room| room.len() == words.len()) {
            room.copy_from_slice(words);
            (place.staged, place.late) = (StagedValue::Waiting, late);
        }
    }

    /// The staged values as (input, words, missed evaluations).
    pub fn staged_values(&self) -> impl Iterator<Item = (u32, &[u64], u16)> {
        let buffers = self.buffers.iter().zip(0u32..);
        let buffers = buffers.filter(|(place, _)| place.staged == StagedValue::Waiting);
        buffers.filter_map(|(place, input)| {
            let words = self.words.get(place.first..place.first + place.width)?;
            Some((input, words, place.late))
        })
    }

    /// Discards all staged values.
    pub fn discard_staged(&mut self) {
        for place in &mut self.buffers {
            place.staged = StagedValue::Nothing;
        }
    }

    /// Stages the values again that the first evaluation took, because its START was refused. Values of other nets are
    /// copied again if they are still published then.
    pub fn restore_first(&mut self, points: &[InputPoint]) {
        for (place, point) in self.buffers.iter_mut().zip(points) {
            if point.topic.is_some() {
                (place.staged, place.source_cycle, place.from_topic) =
                    (StagedValue::Nothing, None, false);
            } else if place.staged == StagedValue::TakenFirst {
                place.staged = StagedValue::Waiting;
            }
        }
    }

    /// Begins an evaluation: writes staged values into the slots; all other values age by `step_s` (s). `first`: the
    /// net evaluates from its initial state.
    pub fn begin(
        &mut self,
        points: &[InputPoint],
        arenas: &mut ArenaSlices<'_>,
        first: bool,
        step_s: f64,
    ) {
        for (point, place) in points.iter().zip(&mut self.buffers) {
            let Some(since) = arenas.ints.get_mut(point.since as usize) else {
                continue;
            };
            let waits = place.staged == StagedValue::Waiting;
            *since = match (waits, *since) {
                (true, _) => i64::from(place.late),
                (false, NULL_INT) => continue,
                (false, evaluations) => evaluations.saturating_add(1),
            };
            let since = *since;
            if let Some(age) = arenas.reals.get_mut(point.age as usize) {
                *age = since as f64 * step_s;
            }
            if waits {
                place.staged = if first {
                    StagedValue::TakenFirst
                } else {
                    StagedValue::Nothing
                };
                let words = self.words.get(place.first..place.first + place.width);
                arenas.write(point, words.unwrap_or_default());
            }
            if point.expires > 0 && since > i64::from(point.expires) {
                arenas.clear(point);
            }
        }
    }
}

impl ArenaSlices<'_> {
    fn write(&mut self, point: &InputPoint, words: &[u64]) {
        let (slot, width) = (point.slot as usize, point.width as usize);
        match point.store {
            Store::Real => {
                for (place, word) in self.reals.iter_mut().skip(slot).take(width).zip(words) {
                    let value = f64::from_bits(*word);
                    *place = if value.is_nan() { NULL_REAL } else { value };
                }
            }
            Store::Bool => {
                for (place, word) in self.bools.iter_mut().skip(slot).take(width).zip(words) {
                    *place = (*word).min(u64::from(NULL_BOOL)) as u8;
                }
            }
            Store::Int => {
                for (place, word) in self.ints.iter_mut().skip(slot).take(width).zip(words) {
                    *place = word.cast_signed();
                }
            }
        }
    }

    fn clear(&mut self, point: &InputPoint) {
        let (slot, width) = (point.slot as usize, point.width as usize);
        match point.store {
            Store::Real => {
                let buffers = self.reals.iter_mut().skip(slot).take(width);
                buffers.for_each(|place| *place = NULL_REAL);
            }
            Store::Bool => {
                let buffers = self.bools.iter_mut().skip(slot).take(width);
                buffers.for_each(|place| *place = NULL_BOOL);
            }
            Store::Int => {
                let buffers = self.ints.iter_mut().skip(slot).take(width);
                buffers.for_each(|place| *place = NULL_INT);
            }
        }
    }
}

/// Null as a word.
pub const fn null(store: Store) -> u64 {
    match store {
        Store::Real => NULL_REAL.to_bits(),
        Store::Bool => NULL_BOOL as u64,
        Store::Int => NULL_INT.cast_unsigned(),
    }
}

fn check(plan: &Plan<'_>, value: &InputValue) -> Result<(), InputFault> {
    let point = plan.inputs.get(value.input as usize);
    let point = point.ok_or(InputFault::Unknown)?;
    if point.topic.is_some() {
        return Err(InputFault::Subscribed);
    }
    if value.words.len() != point.width as usize {
        return Err(InputFault::Elements);
    }
    for (word, element) in value.words.iter().zip(0u32..) {
        let good = match point.store {
            Store::Real => !f64::from_bits(*word).is_infinite(),
            Store::Bool => *word <= u64::from(NULL_BOOL),
            Store::Int => true,
        };
        if !good {
            return Err(InputFault::NoValue);
        }
        let inside = |bound: Option<u32>, least: bool| {
            let bound = bound.map(|slot| (slot + element) as usize);
            bound.is_none_or(|slot| is_inside(plan, point.store, *word, slot, least))
        };
        if !inside(point.at_least, true) || !inside(point.at_most, false) {
            return Err(InputFault::OutOfRange);
        }
    }
    Ok(())
}

/// Null is in every range, and a null bound does not limit.
fn is_inside(plan: &Plan<'_>, store: Store, word: u64, slot: usize, least: bool) -> bool {
    match store {
        Store::Real => plan.reals.get(slot).is_none_or(|bound| {
            let value = f64::from_bits(word);
            // Written such that a NaN on either side counts as inside.
            !(if least {
                value < *bound
            } else {
                value > *bound
            })
        }),
        Store::Int => plan.ints.get(slot).is_none_or(|bound| {
            let value = word.cast_signed();
            let outside = if least {
                value < *bound
            } else {
                value > *bound
            };
            value == NULL_INT || *bound == NULL_INT || !outside
        }),
        Store::Bool => true,
    }
}
