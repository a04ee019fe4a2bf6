//! Inputs and outputs of the station that the simulated cabinet lists in every message.
//! Run by the clock thread.

use super::fault::AnswerRefusal;
use crate::fri_iiwa::wire::schema::IoValue;
use crate::fri_iiwa::wire::{IO_NAME_MAX, IoDirection, IoKind};
use serde::Serialize;
use std::str::FromStr;

/// One input or output.
#[derive(Clone, Debug, PartialEq)]
pub struct StationSignal {
    /// `Group.Name`.
    pub name: String,
    /// Type.
    pub kind: IoKind,
    /// Direction, as the client sees it: it reads inputs and writes outputs.
    pub direction: IoDirection,
    /// Value: 0 or 1, a whole number, or a real one.
    pub value: f64,
}

/// Name and value, for the control port.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SignalState {
    /// `Group.Name`.
    pub name: String,
    /// `input` or `output`.
    pub direction: &'static str,
    /// Value.
    pub value: f64,
}

/// Why a signal is invalid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "invalid signal `{0}`: write GROUP.NAME=TYPE:DIRECTION with boolean, digital or analog, and input or output; at most 63 bytes"
)]
pub struct SignalError(pub String);

impl FromStr for StationSignal {
    type Err = SignalError;

    fn from_str(text: &str) -> Result<Self, SignalError> {
        let refuse = || SignalError(text.to_owned());
        let (name, of) = text.split_once('=').ok_or_else(refuse)?;
        let (kind, direction) = of.split_once(':').ok_or_else(refuse)?;
        let parts = name.split_once('.');
        let named = parts.is_some_and(|(group, name)| !group.is_empty() && !name.is_empty());
        if !named || name.len() > IO_NAME_MAX {
            return Err(refuse());
        }
        Ok(Self {
            name: name.to_owned(),
            kind: match kind {
                "boolean" => IoKind::Boolean,
                "digital" => IoKind::Digital,
                "analog" => IoKind::Analog,
                _ => return Err(refuse()),
            },
            direction: match direction {
                "input" => IoDirection::Input,
                "output" => IoDirection::Output,
                _ => return Err(refuse()),
            },
            value: 0.0,
        })
    }
}

/// An output that is looped back to an input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SignalLoopback {
    /// Name of the output.
    pub output: String,
    /// Name of the input.
    pub input: String,
}

impl FromStr for SignalLoopback {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (output, input) = text.split_once('=').ok_or_else(|| {
            format!("invalid loopback `{text}`: write OUTPUT=INPUT, the names of two signals")
        })?;
        Ok(Self {
            output: output.to_owned(),
            input: input.to_owned(),
        })
    }
}

/// The signals, in the order of the messages.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Station {
    signals: Vec<StationSignal>,
    loopbacks: Vec<SignalLoopback>,
}

impl Station {
    /// Returns a station with these signals.
    #[must_use]
    pub fn new(signals: Vec<StationSignal>, loopbacks: Vec<SignalLoopback>) -> Self {
        Self { signals, loopbacks }
    }

    /// Returns the list of a message.
    #[must_use]
    pub fn listed(&self) -> Vec<IoValue> {
        self.signals.iter().map(StationSignal::listed).collect()
    }

    /// Returns the states of all signals.
    #[must_use]
    pub fn states(&self) -> Vec<SignalState> {
        let state = |signal: &StationSignal| SignalState {
            name: signal.name.clone(),
            direction: match signal.direction {
                IoDirection::Input => "input",
                IoDirection::Output => "output",
            },
            value: signal.value,
        };
        self.signals.iter().map(state).collect()
    }

    /// Returns the Boolean outputs as bits, in the order of the list.
    #[must_use]
    pub fn bits(&self) -> u16 {
        let outputs = self.signals.iter().filter(|signal| {
            signal.kind == IoKind::Boolean && signal.direction == IoDirection::Output
        });
        let set = outputs.take(16).enumerate();
        set.fold(0, |bits, (place, signal)| {
            bits | u16::from(signal.value != 0.0) << place
        })
    }

    /// Sets the input `name`; returns false if there is none, or if its type cannot have the value.
    pub fn set_input(&mut self, name: &str, value: f64) -> bool {
        let found = self.signals.iter_mut().find(|signal| signal.name == name);
        let fits = |signal: &StationSignal| {
            signal.direction == IoDirection::Input && fits(signal.kind, value)
        };
        match found.filter(|signal| fits(signal)) {
            Some(signal) => {
                signal.value = value;
                true
            }
            None => false,
        }
    }

    /// Checks what a client writes.
    ///
    /// # Errors
    /// Returns the first entry that does not name an output of this station, has another type, or has no value.
    pub fn check(&self, written: &[IoValue]) -> Result<(), AnswerRefusal> {
        let first = written.iter().find(|io| self.place(io).is_none());
        match first {
            None => Ok(()),
            Some(io) => Err(AnswerRefusal::Io(io.name.clone().unwrap_or_default())),
        }
    }

    /// Latches what a client writes, and loops it back.
    pub fn write(&mut self, written: &[IoValue]) {
        for io in written {
            if let Some((place, value)) = self.place(io)
                && let Some(signal) = self.signals.get_mut(place)
            {
                signal.value = value;
            }
        }
        for SignalLoopback { output, input } in &self.loopbacks {
            let value = self.signals.iter().find(|signal| signal.name == *output);
            let value = value.map(|signal| signal.value);
            let to = self.signals.iter_mut().find(|signal| signal.name == *input);
            if let (Some(value), Some(signal)) = (value, to) {
                signal.value = value;
            }
        }
    }

    /// Returns the place of the output, and the value.
    fn place(&self, io: &IoValue) -> Option<(usize, f64)> {
        let name = io.name.as_deref()?;
        let place = self.signals.iter().position(|signal| signal.name == name)?;
        let signal = self.signals.get(place)?;
        let value = match signal.kind {
            IoKind::Analog => io.analog?,
            IoKind::Boolean | IoKind::Digital => io.digital? as f64,
        };
        let is_output = signal.direction == IoDirection::Output
            && io.direction == Some(IoDirection::Output as i32)
            && io.kind == Some(signal.kind as i32);
        (is_output && fits(signal.kind, value)).then_some((place, value))
    }
}

fn fits(kind: IoKind, value: f64) -> bool {
    match kind {
        IoKind::Boolean => value == 0.0 || value == 1.0,
        IoKind::Digital => value >= 0.0 && value.fract() == 0.0 && value < u64::MAX as f64,
        IoKind::Analog => value.is_finite(),
    }
}

impl StationSignal {
    fn listed(&self) -> IoValue {
        let analog = self.kind == IoKind::Analog;
        IoValue {
            name: Some(self.name.clone()),
            kind: Some(self.kind as i32),
            direction: Some(self.direction as i32),
            digital: (!analog).then_some(self.value as u64),
            analog: analog.then_some(self.value),
        }
    }
}
