//! The channels of the device as places in the process images of the terminals.
//! Made once, when the driver is opened; used by the host's thread, without allocation.

use rcc_driver_kit::driver::{
    DriverError, Inputs, Outputs, channel_error, channels, to_raw, to_si,
};
use rcc_driver_kit::host::output_release::OutputRelease;
use rcc_driver_kit::rcc_config::device::{is_digital, is_output};
use rcc_driver_kit::rcc_config::{ChannelConfig, DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::primitive::ChannelKind;

use super::address::{self, Format, Place};
use super::axis_settings::DrivePlace;
use super::power_state::command;
use super::settings::EthercatSettings;
use super::terminal_settings::TerminalSettings;
use crate::session::{ObjectData, ObjectValue, TerminalImage};
use crate::terminals::Channels;

/// Bits of the status word of an analog input without a valid value: underrange, overrange, error, and bit 14, by which the
/// terminal says so itself.
const INVALID: u16 = 0x4043;
/// Sub-index of an analog output's value without communication, in the object 0x80n0.
const DEFAULT_OUTPUT: u8 = 0x13;

/// Address of the digital output that permits the drives.
const ENABLE: &str = "axes enable";

/// A channel and its place.
#[derive(Clone, Debug)]
pub struct Point {
    /// Index among the channels of its kind.
    index: u32,
    place: Place,
    config: ChannelConfig,
}

/// All channels, in the order of their indices.
#[derive(Clone, Debug)]
pub struct Points {
    digital_in: Vec<Point>,
    digital_out: Vec<Point>,
    analog_in: Vec<Point>,
    analog_out: Vec<Point>,
    /// Index of the digital output that permits the drives.
    enable: Option<u32>,
    drives: Vec<DrivePlace>,
    /// Values of the outputs without a command.
    released: Outputs,
}

impl Points {
    /// Reads the addresses of all channels.
    ///
    /// # Errors
    /// Returns an error for an address that does not exist, for outputs that share a bit, and for a range that does not fit.
    pub fn new(device: &DeviceConfig, settings: &EthercatSettings) -> Result<Points, DriverError> {
        let terminals = &settings.terminals;
        let drives: Vec<DrivePlace> = settings.axes.iter().map(|axis| axis.place).collect();
        let enable = enable(device, !drives.is_empty())?;
        let of = |kind| -> Result<Vec<Point>, DriverError> {
            let permits = |channel: &ChannelConfig| {
                kind == ChannelKind::DigitalOutput && Some(channel.index) == enable
            };
            let found = channels(device, kind).into_iter();
            found
                .filter(|channel| !permits(channel))
                .map(|channel| point(device, channel, terminals))
                .collect()
        };
        let points = Points {
            digital_in: of(ChannelKind::DigitalInput)?,
            digital_out: of(ChannelKind::DigitalOutput)?,
            analog_in: of(ChannelKind::AnalogInput)?,
            analog_out: of(ChannelKind::AnalogOutput)?,
            enable,
            drives,
            released: *OutputRelease::new(device).values(),
        };
        let outputs: Vec<&Point> = points
            .digital_out
            .iter()
            .chain(&points.analog_out)
            .collect();
        for (place, point) in outputs.iter().enumerate() {
            let mut before = outputs.iter().take(place);
            if let Some(other) = before.find(|other| other.place.overlaps(&point.place)) {
                let cause = format!("it shares bits with the output '{}'", other.config.name);
                let expected = "a place of its own for each output";
                return Err(channel_error(device, &point.config, cause, expected));
            }
            let mut drives = points.drives.iter();
            if drives.any(|drive| drive.places().any(|place| place.overlaps(&point.place))) {
                let cause = "it shares bits with the controlword or the target position of a drive";
                let expected = "a place that no axis uses";
                return Err(channel_error(device, &point.config, cause, expected));
            }
        }
        Ok(points)
    }

    /// Checks that all places exist in the process data of the line.
    ///
    /// # Errors
    /// Returns the first one that does not, in words.
    pub fn check(&self, image: &[TerminalImage]) -> Result<(), String> {
        let inputs = self.digital_in.iter().chain(&self.analog_in);
        let outputs = self.digital_out.iter().chain(&self.analog_out);
        let rows = inputs
            .map(|point| (point, false))
            .chain(outputs.map(|point| (point, true)));
        for (point, output) in rows {
            let terminal = image.get(point.place.terminal);
            let size = terminal.map_or(0, |image| match output {
                true => image.outputs.len(),
                false => image.inputs.len(),
            });
            if point.place.bytes() > size {
                return Err(format!(
                    "channel {}: terminal {} has {size} bytes of {}, not {}",
                    point.config.name,
                    point.place.terminal + 1,
                    if output { "outputs" } else { "inputs" },
                    point.place.bytes(),
                ));
            }
        }
        for drive in &self.drives {
            let terminal = image.get(drive.terminal);
            let [outputs, inputs] = drive.sizes();
            let has = terminal.map_or([0; 2], |one| [one.outputs.len(), one.inputs.len()]);
            if has[0] < outputs || has[1] < inputs {
                return Err(format!(
                    "terminal {} has {} bytes of outputs and {} of inputs; the values of its axis need {outputs} and {inputs}",
                    drive.terminal + 1,
                    has[0],
                    has[1],
                ));
            }
        }
        Ok(())
    }

    /// Returns the index of the digital output that permits the drives.
    #[must_use]
    pub fn enable(&self) -> Option<u32> {
        self.enable
    }

    /// Converts the newest inputs of the line.
    pub fn inputs(&self, image: &[TerminalImage], inputs: &mut Inputs) {
        *inputs = Inputs::NONE;
        for point in &self.digital_in {
            let index = point.index;
            if let Some(value) = read(image, point.place) {
                inputs.digital |= u64::from(value != 0.0) << index;
                inputs.digital_known |= 1 << index;
            }
        }
        for (point, place) in self.analog_in.iter().zip(&mut inputs.analog) {
            let valid = |value: &f64| value.is_finite();
            let raw = read(image, point.place).filter(valid);
            *place = raw.map_or(f64::NAN, |raw| to_si(&point.config, raw));
        }
    }

    /// Outputs that hold and were not commanded since their terminals last switched off have no value: they stay off until a
    /// net commands them. `commanded` has the bits of those that were, digital and analog.
    #[must_use]
    pub fn without_old(&self, outputs: &Outputs, commanded: [u64; 2]) -> Outputs {
        let [digital, analog] = commanded;
        let mut outputs = *outputs;
        outputs.digital_set &= digital | self.released.digital_set;
        for (place, index) in outputs.analog.iter_mut().zip(0..) {
            let has_safe = self
                .released
                .analog
                .get(index)
                .is_some_and(|safe| safe.is_finite());
            if !has_safe && analog >> index & 1 == 0 {
                *place = f64::NAN;
            }
        }
        outputs
    }

    /// Writes the outputs that have a value into the images of the terminals.
    pub fn put(&self, outputs: &Outputs, image: &mut [TerminalImage]) {
        for point in &self.digital_out {
            let index = point.index;
            if outputs.digital_set >> index & 1 == 1 {
                let on = outputs.digital >> index & 1 == 1;
                write(image, point.place, f64::from(u8::from(on)));
            }
        }
        for (point, value) in self.analog_out.iter().zip(outputs.analog) {
            if value.is_finite() {
                write(image, point.place, to_raw(&point.config, value));
            }
        }
    }

    /// Writes the safe values into the images of the terminals: outputs that hold keep theirs, and drives make a quick stop.
    pub fn release(&self, image: &mut [TerminalImage]) {
        self.put(&self.released, image);
        for drive in &self.drives {
            let image = image.get_mut(drive.terminal);
            let word = image.and_then(|one| one.outputs.get_mut(drive.control..drive.control + 2));
            if let Some(word) = word {
                word.copy_from_slice(&command::QUICK_STOP.to_le_bytes());
            }
        }
    }

    /// Returns the settings by which the terminal at `position` takes the safe values without communication, if it can.
    #[must_use]
    pub fn default_outputs(
        &self,
        position: usize,
        terminal: &TerminalSettings,
    ) -> Vec<ObjectValue> {
        let analog = Channels::AnalogOutput;
        let Some(model) = terminal.model.filter(|model| model.channels == analog) else {
            return Vec::new();
        };
        let own = self.analog_out.iter();
        let own = own.filter(|point| point.place.terminal == position);
        let object = own.filter_map(|point| {
            let Some(OnRelease::Safe(value)) = point.config.on_release else {
                return None;
            };
            let channel = point.place.bit / usize::from(model.channel_bits());
            Some(ObjectValue {
                index: 0x8000 + u16::try_from(channel).ok()? * 0x10,
                sub_index: DEFAULT_OUTPUT,
                // Within the range, which fits.
                value: ObjectData::I16(to_raw(&point.config, value).round() as i16),
            })
        });
        object.collect()
    }

    /// Returns the names of outputs whose value without communication differs from that of their `on_release`: digital ones
    /// that are on or hold, and analog ones that hold.
    pub fn unlike_watchdog(&self) -> impl Iterator<Item = &str> {
        let digital = self.digital_out.iter();
        let digital = digital.filter(|one| one.config.on_release != Some(OnRelease::Safe(0.0)));
        let analog = self.analog_out.iter();
        let analog = analog.filter(|one| one.config.on_release == Some(OnRelease::Hold));
        digital
            .chain(analog)
            .map(|point| point.config.name.as_str())
    }
}

/// Finds the digital output that permits the drives, and checks that nothing holds it.
fn enable(device: &DeviceConfig, has_axes: bool) -> Result<Option<u32>, DriverError> {
    let outputs = channels(device, ChannelKind::DigitalOutput).into_iter();
    let mut found = outputs.filter(|channel| has_axes && channel.address.as_str() == Some(ENABLE));
    let Some(first) = found.next() else {
        return Ok(None);
    };
    if first.on_release != Some(OnRelease::Safe(0.0)) {
        let cause = "the drives would stay enabled without a net";
        let expected = "`on_release: {safe: false}`";
        return Err(channel_error(device, first, cause, expected));
    }
    if let Some(second) = found.next() {
        let cause = format!("`{ENABLE}` is already the address of '{}'", first.name);
        let expected = "one output that permits the drives";
        return Err(channel_error(device, second, cause, expected));
    }
    Ok(Some(first.index))
}

fn point(
    device: &DeviceConfig,
    channel: &ChannelConfig,
    terminals: &[TerminalSettings],
) -> Result<Point, DriverError> {
    let expected = "a terminal and a place: `lamps channel 1`, `lamps bit 0`, `other byte 4 i16`, `pressures 0x6000:11`";
    let (output, digital) = (is_output(channel.kind), is_digital(channel.kind));
    let text = channel.address.as_str();
    let place = text
        .ok_or_else(|| format!("{} is no address", channel.address))
        .and_then(|text| address::read(text, output, digital, terminals));
    let place = place.map_err(|cause| channel_error(device, channel, cause, expected))?;
    if output && !digital {
        let [lower, upper] = place.format.bounds();
        let Some(range) = channel.range else {
            let cause = "its `range` is missing, and nothing is clamped";
            let expected = "the smallest and the largest value: `range: [0 V, 10 V]`";
            return Err(channel_error(device, channel, cause, expected));
        };
        let fits = |value: f64| (lower..=upper).contains(&to_raw(channel, value).round());
        if !range.into_iter().all(fits) {
            let cause = format!("its range does not fit into the raw numbers {lower} to {upper}");
            let expected = "a `range` and a `scale` that fit";
            return Err(channel_error(device, channel, cause, expected));
        }
    }
    Ok(Point {
        index: channel.index,
        place,
        config: channel.clone(),
    })
}

/// Reads a raw value; `None` if it is invalid by the terminal's own word, or not there.
fn read(image: &[TerminalImage], place: Place) -> Option<f64> {
    let bytes = image.get(place.terminal)?.inputs.as_slice();
    let at = place.bit / 8;
    if let Some(status) = place.status {
        let status = u16::from_le_bytes(array(bytes, status)?);
        if status & INVALID != 0 {
            return None;
        }
    }
    Some(match place.format {
        Format::Bit => f64::from(bytes.get(at)? >> (place.bit % 8) & 1),
        Format::U8 => f64::from(*bytes.get(at)?),
        Format::I8 => f64::from(bytes.get(at)?.cast_signed()),
        Format::U16 => f64::from(u16::from_le_bytes(array(bytes, at)?)),
        Format::I16 => f64::from(i16::from_le_bytes(array(bytes, at)?)),
        Format::U32 => f64::from(u32::from_le_bytes(array(bytes, at)?)),
        Format::I32 => f64::from(i32::from_le_bytes(array(bytes, at)?)),
        Format::F32 => f64::from(f32::from_le_bytes(array(bytes, at)?)),
    })
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at + N)?.try_into().ok()
}

/// Writes a raw value, rounded; the host keeps it within the range, which fits. Numbers are whole bytes: an entry of a known
/// type, or `byte N`.
fn write(image: &mut [TerminalImage], place: Place, raw: f64) {
    let Some(image) = image.get_mut(place.terminal) else {
        return;
    };
    let at = place.bit / 8;
    let whole = raw.round();
    let mut put = |value: &[u8]| {
        if let Some(bytes) = image.outputs.get_mut(at..at + value.len()) {
            bytes.copy_from_slice(value);
        }
    };
    match place.format {
        Format::Bit => {
            if let Some(byte) = image.outputs.get_mut(at) {
                let bit = 1 << (place.bit % 8);
                *byte = *byte & !bit | if raw != 0.0 { bit } else { 0 };
            }
        }
        Format::U8 => put(&[whole as u8]),
        Format::I8 => put(&(whole as i8).to_le_bytes()),
        Format::U16 => put(&(whole as u16).to_le_bytes()),
        Format::I16 => put(&(whole as i16).to_le_bytes()),
        Format::U32 => put(&(whole as u32).to_le_bytes()),
        Format::I32 => put(&(whole as i32).to_le_bytes()),
        Format::F32 => put(&(raw as f32).to_le_bytes()),
    }
}

#[cfg(test)]
mod tests;
