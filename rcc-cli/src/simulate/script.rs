//! Scripted inputs of a simulation: `io.door_closed=true@2s`. Pure.

use std::time::Duration;

use rcc_config::{CellConfig, quantity};
use rcc_core::primitive::ChannelKind;
use thiserror::Error;

use super::device::SimulatedDevice;
use crate::duration::duration;

/// Sets one input once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptStep {
    /// Logical time from which the value applies, ns.
    pub at_ns: u64,
    device: usize,
    index: usize,
    value: ScriptedValue,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ScriptedValue {
    Digital(Option<bool>),
    Analog(f64),
}

/// Reason why an `--input` is invalid.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ScriptError {
    /// It has another form.
    #[error("`{text}`: write device.channel=value, or device.channel=value@time")]
    Form {
        /// The argument as given.
        text: String,
    },
    /// The device does not exist.
    #[error("`{text}`: device `{device}` not found; available devices: {known}")]
    SimulatedDevice {
        /// The argument as given.
        text: String,
        /// Name in the argument.
        device: String,
        /// Names of the devices.
        known: String,
    },
    /// The device has no such input.
    #[error("`{text}`: device `{device}` has no input `{channel}`; available inputs: {known}")]
    Channel {
        /// The argument as given.
        text: String,
        /// The device.
        device: String,
        /// Name in the argument.
        channel: String,
        /// Names of its inputs.
        known: String,
    },
    /// The value does not suit the channel.
    #[error("`{text}`: {cause}")]
    Value {
        /// The argument as given.
        text: String,
        /// What is wrong with the value.
        cause: String,
    },
}

impl ScriptStep {
    /// Parses an argument for the devices of a cell. Without `@time` the value applies from the start.
    ///
    /// # Errors
    /// Fails if form, device, channel, value or time are invalid.
    pub fn parse(text: &str, config: &CellConfig) -> Result<ScriptStep, ScriptError> {
        let form = || ScriptError::Form {
            text: text.to_owned(),
        };
        let (name, rest) = text.split_once('=').ok_or_else(form)?;
        let (value, at) = match rest.rsplit_once('@') {
            Some((value, at)) => (value, duration(at).map_err(|_| form())?),
            None => (rest, Duration::ZERO),
        };
        let (device_name, channel_name) = name.trim().split_once('.').ok_or_else(form)?;
        let (device, found) = config.device(device_name).ok_or_else(|| {
            let known: Vec<&str> = config.devices.iter().map(|row| row.name.as_str()).collect();
            ScriptError::SimulatedDevice {
                text: text.to_owned(),
                device: device_name.to_owned(),
                known: known.join(", "),
            }
        })?;
        let kinds = [ChannelKind::DigitalInput, ChannelKind::AnalogInput];
        let channel = kinds
            .iter()
            .find_map(|kind| found.channel(*kind, channel_name));
        let channel = channel.ok_or_else(|| {
            let inputs = kinds.iter().flat_map(|kind| found.channels_of(*kind));
            let known: Vec<&str> = inputs.map(|row| row.name.as_str()).collect();
            ScriptError::Channel {
                text: text.to_owned(),
                device: device_name.to_owned(),
                channel: channel_name.to_owned(),
                known: known.join(", "),
            }
        })?;
        let bad = |cause: String| ScriptError::Value {
            text: text.to_owned(),
            cause,
        };
        let value = match (channel.kind, value.trim()) {
            (ChannelKind::DigitalInput, "true") => ScriptedValue::Digital(Some(true)),
            (ChannelKind::DigitalInput, "false") => ScriptedValue::Digital(Some(false)),
            (ChannelKind::DigitalInput, "null") => ScriptedValue::Digital(None),
            (ChannelKind::DigitalInput, _) => {
                return Err(bad("a digital input is true, false or null".to_owned()));
            }
            (_, "null") => ScriptedValue::Analog(f64::NAN),
            (_, value) => {
                let quantity = quantity::parse(value).map_err(|error| bad(error.to_string()))?;
                if quantity.unit.is_some_and(|unit| unit != channel.unit) {
                    return Err(bad(format!(
                        "expected a value in the unit {}",
                        channel.unit
                    )));
                }
                ScriptedValue::Analog(quantity.value)
            }
        };
        Ok(ScriptStep {
            at_ns: at.as_nanos().try_into().unwrap_or(u64::MAX),
            device,
            index: channel.index as usize,
            value,
        })
    }

    /// Sets the input.
    pub fn apply(&self, devices: &mut [SimulatedDevice]) {
        let Some(device) = devices.get_mut(self.device) else {
            return;
        };
        match self.value {
            ScriptedValue::Digital(value) => device.set_digital(self.index, value),
            ScriptedValue::Analog(value) => device.set_analog(self.index, value),
        }
    }
}
