//! The newest value of each channel: written by Zenoh's threads, read by the exchange thread once a period. The lock is held
//! for copies of numbers only; messages are parsed outside of it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rcc_core::primitive::ChannelKind;
use rcc_driver_kit::driver::Inputs;
use serde_json::{Value, json};

use super::channels::LinkChannel;
use super::wanted;
use crate::age::{AgedValue, Transit};
use crate::message::TopicMessage;

/// Earlier lives of the sender whose late messages are recognised.
const SENDERS_KEPT: usize = 8;

/// State of a channel, from the best to the worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ChannelState {
    /// It has a value, which may be null.
    Fresh,
    /// Its value is too old.
    Stale,
    /// No value has arrived.
    Never,
    /// The topic has another type or unit.
    OtherKind,
}

/// Values of all channels in one period of the exchange thread.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Known values.
    pub inputs: Inputs,
    /// Channels with a fresh value.
    pub fresh: usize,
    /// The worst state.
    pub worst: ChannelState,
    /// Messages that were refused.
    pub refused: u64,
    /// Messages that newer ones had overtaken.
    pub out_of_order: u64,
}

/// Newest values.
#[derive(Debug)]
pub(super) struct Inbox {
    channels: Vec<LinkChannel>,
    origin: Instant,
    state: Mutex<InboxState>,
}

#[derive(Debug)]
struct InboxState {
    /// The present life of the sender, and the ones before it, oldest first.
    senders: Vec<String>,
    transit: Transit,
    /// Newest number of each topic.
    sequences: BTreeMap<String, u64>,
    /// By channel: the newest value; `Err`: type and unit that arrived instead.
    values: Vec<Option<Result<AgedValue, String>>>,
    refused: u64,
    out_of_order: u64,
}

impl Inbox {
    pub fn new(channels: Vec<LinkChannel>) -> Inbox {
        let values = channels.iter().map(|_| None).collect();
        Inbox {
            channels,
            origin: Instant::now(),
            state: Mutex::new(InboxState {
                senders: Vec::new(),
                transit: Transit::default(),
                sequences: BTreeMap::new(),
                values,
                refused: 0,
                out_of_order: 0,
            }),
        }
    }

    pub fn channels(&self) -> &[LinkChannel] {
        &self.channels
    }

    /// Returns the topics, each once.
    pub fn topics(&self) -> BTreeSet<String> {
        self.channels
            .iter()
            .map(|channel| channel.topic.clone())
            .collect()
    }

    /// Returns the own monotonic clock, ns since this inbox was made.
    pub fn now_ns(&self) -> u64 {
        u64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn state(&self) -> MutexGuard<'_, InboxState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a message that cannot be taken.
    pub fn refuse(&self) {
        self.state().refused += 1;
    }

    /// Takes a message that arrives now.
    pub fn take(&self, topic: &str, bytes: &[u8]) {
        self.take_at(topic, bytes, self.now_ns());
    }

    pub fn take_at(&self, topic: &str, bytes: &[u8], arrival_ns: u64) {
        let message = match TopicMessage::read(bytes) {
            Ok(message) => message,
            Err(error) => {
                tracing::debug!(topic, %error, "a message is refused");
                self.refuse();
                return;
            }
        };
        let values = self.channels.iter().map(|channel| {
            let is_its = channel.topic == topic;
            is_its.then(|| value_for(channel, &message))
        });
        let values: Vec<Option<Result<Option<f64>, String>>> = values.collect();
        self.state().store(topic, &message, values, arrival_ns);
    }

    /// Returns what is known now.
    pub fn read(&self, expires_ns: u64) -> Reading {
        self.read_at(self.now_ns(), expires_ns)
    }

    pub fn read_at(&self, now_ns: u64, expires_ns: u64) -> Reading {
        let state = self.state();
        let mut reading = Reading {
            inputs: Inputs::NONE,
            fresh: 0,
            worst: ChannelState::Fresh,
            refused: state.refused,
            out_of_order: state.out_of_order,
        };
        for (channel, value) in self.channels.iter().zip(&state.values) {
            let (of_channel, value) = state_of(value.as_ref(), now_ns, expires_ns);
            reading.worst = reading.worst.max(of_channel);
            reading.fresh += usize::from(of_channel == ChannelState::Fresh);
            let Some(value) = value else { continue };
            if channel.kind == ChannelKind::DigitalInput {
                reading.inputs.digital_known |= 1 << channel.index;
                reading.inputs.digital |= u64::from(value != 0.0) << channel.index;
            } else if let Some(place) = reading.inputs.analog.get_mut(channel.index as usize) {
                *place = value;
            }
        }
        reading
    }

    /// Describes each channel for `doctor`.
    pub fn describe(&self, now_ns: u64, expires_ns: u64) -> Value {
        let state = self.state();
        let rows = self
            .channels
            .iter()
            .zip(&state.values)
            .map(|(channel, value)| {
                let (of_channel, present) = state_of(value.as_ref(), now_ns, expires_ns);
                let words = match (of_channel, present) {
                    (ChannelState::Fresh, Some(_)) => "a value".to_owned(),
                    (ChannelState::Fresh, None) => {
                        "null: it is published as null, or by nobody".to_owned()
                    }
                    (ChannelState::Stale, _) => "too old: null".to_owned(),
                    (ChannelState::Never, _) => "never arrived".to_owned(),
                    (ChannelState::OtherKind, _) => match value {
                        Some(Err(have)) => {
                            format!("is {have}, but the channel is {}", wanted(channel))
                        }
                        _ => String::new(),
                    },
                };
                let age = match value {
                    Some(Ok(value)) => Some(value.age_at(now_ns) as f64 * 1e-6),
                    _ => None,
                };
                let row = json!({"topic": channel.topic, "state": words, "age_ms": age});
                (channel.name.clone(), row)
            });
        Value::Object(rows.collect())
    }
}

impl InboxState {
    fn store(
        &mut self,
        topic: &str,
        message: &TopicMessage,
        values: Vec<Option<Result<Option<f64>, String>>>,
        arrival_ns: u64,
    ) {
        if self.senders.last() != Some(&message.sender) {
            // A message of an earlier life that arrives late.
            if self.senders.contains(&message.sender) {
                self.out_of_order += 1;
                return;
            }
            self.senders.push(message.sender.clone());
            if self.senders.len() > SENDERS_KEPT {
                self.senders.remove(0);
            }
            self.sequences.clear();
            self.transit = Transit::default();
        }
        let newest = self.sequences.entry(topic.to_owned()).or_insert(0);
        if message.sequence <= *newest {
            self.out_of_order += 1;
            return;
        }
        *newest = message.sequence;
        let delay_ns = self.transit.delay_ns(message.sent_ns, arrival_ns);
        for (place, value) in self.values.iter_mut().zip(values) {
            let Some(value) = value else { continue };
            *place = Some(value.map(|value| AgedValue {
                value,
                age_ns: message.age_ns.saturating_add(delay_ns),
                arrival_ns,
            }));
        }
    }
}

/// Returns the state of a channel, and its value if it is fresh and not null.
fn state_of(
    value: Option<&Result<AgedValue, String>>,
    now_ns: u64,
    expires_ns: u64,
) -> (ChannelState, Option<f64>) {
    match value {
        None => (ChannelState::Never, None),
        Some(Err(_)) => (ChannelState::OtherKind, None),
        Some(Ok(value)) if value.age_at(now_ns) > expires_ns => (ChannelState::Stale, None),
        Some(Ok(value)) => (ChannelState::Fresh, value.value),
    }
}

/// Returns the value of a channel in a message; `Err`: the kind of the topic, which is another one.
fn value_for(channel: &LinkChannel, message: &TopicMessage) -> Result<Option<f64>, String> {
    let scalar = match channel.kind {
        ChannelKind::DigitalInput => "Bool",
        _ => "Real",
    };
    let other = || message.kind();
    let (ty, value) = match (channel.element, message.ty.strip_suffix(']')) {
        (None, _) => (message.ty.as_str(), &message.value),
        (Some(_), None) => return Err(other()),
        (Some(element), Some(array)) => {
            let ty = array.split_once('[').map_or("", |(ty, _)| ty);
            match &message.value {
                Value::Null => (ty, &Value::Null),
                Value::Array(values) => (ty, values.get(element).ok_or_else(other)?),
                _ => return Err(other()),
            }
        }
    };
    let unit = message.unit.as_deref().filter(|unit| !unit.is_empty());
    if ty != scalar || unit != channel.unit.as_deref() {
        return Err(other());
    }
    match (value, channel.kind) {
        (Value::Null, _) => Ok(None),
        (Value::Bool(on), ChannelKind::DigitalInput) => Ok(Some(f64::from(u8::from(*on)))),
        (Value::Number(number), ChannelKind::AnalogInput) => {
            Ok(number.as_f64().filter(|value| value.is_finite()))
        }
        _ => Err(other()),
    }
}
