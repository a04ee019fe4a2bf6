//! Scripted events of a simulation: inputs (`io.door_closed=true@2s`), and what touches an arm. Pure.

use std::time::Duration;

use rcc_config::{CellConfig, DeviceConfig, quantity};
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;
use thiserror::Error;

use super::arguments::numbers;
use super::device::SimulatedDevice;
use super::dynamics::FlangeLoad;
use super::reading::Reading;
use super::wall::ElasticWall;
use crate::duration::duration;
use rcc_core::duration::parse_seconds;

/// One event of one device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptStep {
    /// Logical time from which it applies, ns.
    pub at_ns: u64,
    device: usize,
    effect: ScriptEffect,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ScriptEffect {
    Digital(usize, Option<bool>),
    /// SI units; NaN is null.
    Analog(usize, f64),
    /// SI units; NaN is null.
    Reading(Reading, f64),
    Wall(ElasticWall),
    /// N and N·m, base axes.
    Push([f64; 6]),
    Load(FlangeLoad),
}

/// Reason why an event is invalid.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ScriptError {
    /// It has another form.
    #[error("`{text}`: write {form}")]
    Form {
        /// The argument as given.
        text: String,
        /// The form.
        form: &'static str,
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
    /// The arm is not named, or the named device is not an arm.
    #[error("`{text}`: name the arm, as in `{example}:…`; arms of the cell: {known}")]
    Arm {
        /// The argument as given.
        text: String,
        /// An arm of the cell.
        example: String,
        /// Names of the arms.
        known: String,
    },
    /// The value does not suit the channel.
    #[error("`{text}`: {cause}")]
    Value {
        /// The argument as given.
        text: String,
        /// Why the value is refused, as a message.
        cause: String,
    },
}

/// Options whose events belong to an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmOption {
    /// `--wall`
    Wall,
    /// `--force`
    Force,
    /// `--load`
    Load,
}

impl ArmOption {
    fn form(self) -> &'static str {
        match self {
            ArmOption::Wall => {
                "PX,PY,PZ,NX,NY,NZ or PX,PY,PZ,NX,NY,NZ,K,D: a point (m), a direction to the free side, N/m and N·s/m; with DEVICE: before and @TIME after, if needed"
            }
            ArmOption::Force => {
                "FX,FY,FZ or FX,FY,FZ,TX,TY,TZ: N and N·m, axes of the base; with DEVICE: before and @TIME after, if needed"
            }
            ArmOption::Load => {
                "KG or KG,X,Y,Z: the mass and its centre in the flange frame (m); with DEVICE: before and @TIME after, if needed"
            }
        }
    }

    fn effect(self, values: &str) -> Option<ScriptEffect> {
        match self {
            ArmOption::Wall => ElasticWall::parse(values).map(ScriptEffect::Wall),
            ArmOption::Load => FlangeLoad::parse(values).map(ScriptEffect::Load),
            ArmOption::Force => match numbers(values)?[..] {
                [fx, fy, fz] => Some(ScriptEffect::Push([fx, fy, fz, 0.0, 0.0, 0.0])),
                [fx, fy, fz, tx, ty, tz] => Some(ScriptEffect::Push([fx, fy, fz, tx, ty, tz])),
                _ => None,
            },
        }
    }
}

/// An `--input` in its parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assignment<'a> {
    /// The argument as given.
    pub text: &'a str,
    /// Name of what is set.
    pub name: &'a str,
    /// Its value.
    pub value: &'a str,
    /// Logical time from which it applies, ns; 0 if none is given.
    pub at_ns: u64,
}

impl Assignment<'_> {
    /// Splits `NAME=VALUE` or `NAME=VALUE@TIME`.
    ///
    /// # Errors
    /// Fails if the form or the time is invalid.
    pub fn parse(text: &str) -> Result<Assignment<'_>, ScriptError> {
        let form = || ScriptError::Form {
            text: text.to_owned(),
            form: "device.channel=value, or device.channel=value@time",
        };
        let (name, rest) = text.split_once('=').ok_or_else(form)?;
        let (value, at_ns) = timed(rest).ok_or_else(form)?;
        Ok(Assignment {
            text,
            name: name.trim(),
            value: value.trim(),
            at_ns,
        })
    }
}

/// Splits `VALUE@TIME`; without a time it is 0 ns. `None` if the time is invalid.
fn timed(text: &str) -> Option<(&str, u64)> {
    let Some((value, at)) = text.rsplit_once('@') else {
        return Some((text, 0));
    };
    let is_start = parse_seconds(at.trim()).is_ok_and(|seconds| seconds == 0.0);
    let at = if is_start {
        Duration::ZERO
    } else {
        duration(at).ok()?
    };
    Some((value, at.as_nanos().try_into().unwrap_or(u64::MAX)))
}

fn names<'a>(devices: impl Iterator<Item = &'a DeviceConfig>) -> Vec<&'a str> {
    devices.map(|row| row.name.as_str()).collect()
}

impl ScriptStep {
    /// Parses the value of an option that belongs to an arm: `[DEVICE:]NUMBERS[@TIME]`.
    ///
    /// # Errors
    /// Fails if form, device or time are invalid, or if the device is not named and the cell has several arms.
    pub fn of_arm(
        option: ArmOption,
        text: &str,
        config: &CellConfig,
    ) -> Result<ScriptStep, ScriptError> {
        let form = || ScriptError::Form {
            text: text.to_owned(),
            form: option.form(),
        };
        let (name, rest) = match text.split_once(':') {
            Some((name, rest)) => (Some(name.trim()), rest),
            None => (None, text),
        };
        let (values, at_ns) = timed(rest).ok_or_else(form)?;
        let effect = option.effect(values).ok_or_else(form)?;
        let arms = || config.devices.iter().filter(|row| row.robot.is_some());
        let mut wanted = arms().filter(|row| name.is_none_or(|name| row.name == name));
        let (Some(arm), None) = (wanted.next(), wanted.next()) else {
            let known = names(arms());
            return Err(ScriptError::Arm {
                text: text.to_owned(),
                example: known.first().copied().unwrap_or("DEVICE").to_owned(),
                known: known.join(", "),
            });
        };
        Ok(ScriptStep {
            at_ns,
            device: config.device(&arm.name).map_or(0, |(device, _)| device),
            effect,
        })
    }

    /// Parses an input of a device: `name` is `device.channel`, or `device.reading` of an arm.
    ///
    /// # Errors
    /// Fails if form, device, channel or value are invalid.
    pub fn input(
        assignment: &Assignment<'_>,
        name: &str,
        config: &CellConfig,
    ) -> Result<ScriptStep, ScriptError> {
        let text = || assignment.text.to_owned();
        let (device_name, channel_name) =
            name.split_once('.').ok_or_else(|| ScriptError::Form {
                text: text(),
                form: "device.channel=value, or device.channel=value@time",
            })?;
        let (device, found) =
            config
                .device(device_name)
                .ok_or_else(|| ScriptError::SimulatedDevice {
                    text: text(),
                    device: device_name.to_owned(),
                    known: names(config.devices.iter()).join(", "),
                })?;
        let effect = effect(found, channel_name, assignment)?;
        Ok(ScriptStep {
            at_ns: assignment.at_ns,
            device,
            effect,
        })
    }

    /// Applies the event.
    pub fn apply(&self, devices: &mut [SimulatedDevice]) {
        let Some(device) = devices.get_mut(self.device) else {
            return;
        };
        match self.effect {
            ScriptEffect::Digital(index, value) => device.set_digital(index, value),
            ScriptEffect::Analog(index, value) => device.set_analog(index, value),
            ScriptEffect::Reading(reading, value) => device.set_reading(reading, value),
            ScriptEffect::Wall(wall) => {
                if let Some(contact) = device.contact_mut() {
                    contact.wall = Some(wall);
                }
            }
            ScriptEffect::Push(wrench) => {
                if let Some(contact) = device.contact_mut() {
                    contact.pushed = wrench;
                }
            }
            ScriptEffect::Load(load) => {
                if let Some(contact) = device.contact_mut() {
                    contact.load = Some(load);
                }
            }
        }
    }
}

/// Returns the effect of setting a channel or reading of a device.
fn effect(
    device: &DeviceConfig,
    name: &str,
    assignment: &Assignment<'_>,
) -> Result<ScriptEffect, ScriptError> {
    let kinds = [ChannelKind::DigitalInput, ChannelKind::AnalogInput];
    let channel = kinds.iter().find_map(|kind| device.channel(*kind, name));
    let bad = |cause: String| ScriptError::Value {
        text: assignment.text.to_owned(),
        cause,
    };
    if let Some(channel) = channel {
        let index = channel.index as usize;
        return match (channel.kind, assignment.value) {
            (ChannelKind::DigitalInput, "true") => Ok(ScriptEffect::Digital(index, Some(true))),
            (ChannelKind::DigitalInput, "false") => Ok(ScriptEffect::Digital(index, Some(false))),
            (ChannelKind::DigitalInput, "null") => Ok(ScriptEffect::Digital(index, None)),
            (ChannelKind::DigitalInput, _) => {
                Err(bad("a digital input is true, false or null".to_owned()))
            }
            (_, value) => real(value, channel.unit)
                .map(|value| ScriptEffect::Analog(index, value))
                .map_err(bad),
        };
    }
    let joints = device.robot.as_ref().map(|robot| robot.joints.len());
    if let Some(reading) = joints.and_then(|joints| Reading::named(name, joints)) {
        let linear = device.model().is_linear();
        return real(assignment.value, reading.unit(linear))
            .map(|value| ScriptEffect::Reading(reading, value))
            .map_err(bad);
    }
    let inputs = kinds.iter().flat_map(|kind| device.channels_of(*kind));
    let channels = inputs.map(|row| row.name.clone());
    let readings = joints.into_iter().flat_map(Reading::names);
    let known: Vec<String> = channels.chain(readings).collect();
    Err(ScriptError::Channel {
        text: assignment.text.to_owned(),
        device: device.name.clone(),
        channel: name.to_owned(),
        known: known.join(", "),
    })
}

/// Parses a number with this unit or none, SI units; `null` is NaN.
fn real(value: &str, unit: Unit) -> Result<f64, String> {
    if value == "null" {
        return Ok(f64::NAN);
    }
    if let Some(number) = value.parse().ok().filter(|number: &f64| number.is_finite()) {
        return Ok(number);
    }
    let quantity = quantity::parse(value).map_err(|error| error.to_string())?;
    match quantity.unit {
        Some(other) if other != unit => Err(format!("expected a value in the unit {unit}")),
        _ => Ok(quantity.value),
    }
}
