//! The wire of both devices: lines of text over UDP, each with a checksum; and what the address of a channel means.
//! Pure functions: tested without a socket, and also used by the simulated devices of the tests.
//!
//! `WORD NUMBER NAME=VALUE … #CRC`: the word says what the line is, the number which period it belongs to.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::{self, ErrorKind};

use rcc_driver_kit::driver::{
    DriverError, Inputs, Outputs, channel_error, channels, to_raw, to_si,
};
use rcc_driver_kit::rcc_config::{ChannelConfig, DeviceConfig};
use rcc_driver_kit::rcc_core::primitive::ChannelKind;

/// Longest line, bytes.
pub const LINE_MAX: usize = 1024;

/// The channels of a device.
#[derive(Clone, Debug)]
pub struct LineChannels {
    digital_inputs: Vec<LineChannel>,
    digital_outputs: Vec<LineChannel>,
    analog_inputs: Vec<LineChannel>,
    analog_outputs: Vec<LineChannel>,
}

/// A channel and its number on the device.
#[derive(Clone, Debug)]
struct LineChannel {
    number: u64,
    config: ChannelConfig,
}

impl LineChannels {
    /// Returns the channels of a device. The driver defines what an `address` means; an error names the channel and the
    /// expected value.
    ///
    /// # Errors
    /// Returns an error for an address that is not a number from 1 to 16, or that another channel of its kind has.
    pub fn of(device: &DeviceConfig) -> Result<Self, DriverError> {
        Ok(Self {
            digital_inputs: line_channels(device, ChannelKind::DigitalInput)?,
            digital_outputs: line_channels(device, ChannelKind::DigitalOutput)?,
            analog_inputs: line_channels(device, ChannelKind::AnalogInput)?,
            analog_outputs: line_channels(device, ChannelKind::AnalogOutput)?,
        })
    }

    /// Appends the outputs to a line. An output without a value is not mentioned.
    pub fn push_outputs(&self, line: &mut String, outputs: &Outputs) {
        for (point, bit) in self.digital_outputs.iter().zip(0..) {
            if outputs.digital_set >> bit & 1 == 1 {
                push(line, 'd', point.number, outputs.digital >> bit & 1);
            }
        }
        for (point, value) in self.analog_outputs.iter().zip(outputs.analog) {
            if value.is_finite() {
                push(line, 'a', point.number, to_raw(&point.config, value));
            }
        }
    }

    /// Returns the inputs among the values of a line, or `None` if one is missing.
    #[must_use]
    pub fn inputs(&self, values: &BTreeMap<String, f64>) -> Option<Inputs> {
        let mut inputs = Inputs::NONE;
        for (point, bit) in self.digital_inputs.iter().zip(0..) {
            let on = *values.get(&format!("d{}", point.number))? != 0.0;
            inputs.digital |= u64::from(on) << bit;
            inputs.digital_known |= 1 << bit;
        }
        for (point, place) in self.analog_inputs.iter().zip(&mut inputs.analog) {
            *place = to_si(&point.config, *values.get(&format!("a{}", point.number))?);
        }
        Some(inputs)
    }
}

fn line_channels(
    device: &DeviceConfig,
    kind: ChannelKind,
) -> Result<Vec<LineChannel>, DriverError> {
    let expected = "a number from 1 to 16 that no other channel of this kind has";
    let mut found: Vec<LineChannel> = Vec::new();
    for channel in channels(device, kind) {
        let number = channel
            .address
            .as_u64()
            .filter(|number| (1..=16).contains(number));
        let number = number.ok_or_else(|| {
            let cause = format!("the device has no channel {}", channel.address);
            channel_error(device, channel, cause, expected)
        })?;
        if let Some(other) = found.iter().find(|other| other.number == number) {
            let cause = format!("number {number} is already used by '{}'", other.config.name);
            return Err(channel_error(device, channel, cause, expected));
        }
        found.push(LineChannel {
            number,
            config: channel.clone(),
        });
    }
    Ok(found)
}

/// Appends a value, such as ` d1=1`.
pub fn push(line: &mut String, kind: char, number: u64, value: impl std::fmt::Display) {
    // Writing to a String cannot fail.
    let _ = write!(line, " {kind}{number}={value}");
}

/// Appends the checksum to a line.
#[must_use]
pub fn seal(line: &str) -> String {
    format!("{line}#{:08x}", crc32(line.as_bytes()))
}

/// Returns the line in these bytes, if its checksum is correct.
#[must_use]
pub fn unseal(bytes: &[u8]) -> Option<&str> {
    let (line, check) = std::str::from_utf8(bytes).ok()?.rsplit_once('#')?;
    (check == format!("{:08x}", crc32(line.as_bytes()))).then_some(line)
}

/// Returns word, number and values of a line; every value is finite.
#[must_use]
pub fn parse(line: &str) -> Option<(&str, u64, BTreeMap<String, f64>)> {
    let mut words = line.split(' ');
    let (word, number) = (words.next()?, words.next()?.parse().ok()?);
    let values = words.map(|pair| {
        let (name, value) = pair.split_once('=')?;
        let value = value
            .parse::<f64>()
            .ok()
            .filter(|value| value.is_finite())?;
        Some((name.to_owned(), value))
    });
    Some((word, number, values.collect::<Option<_>>()?))
}

/// CRC-32 as in IEEE 802.3.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _: u32| (crc >> 1) ^ (0xedb8_8320 * (crc & 1));
    let byte = |crc: u32, byte: &u8| (0..8).fold(crc ^ u32::from(*byte), step);
    !bytes.iter().fold(!0, byte)
}

/// Returns true if nothing arrived in time: a pause, not a failure of the socket.
#[must_use]
pub fn is_pause(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_taken_with_its_check_only() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        let sealed = seal("is 7 d1=1 a1=0.25");
        let line = unseal(sealed.as_bytes());
        assert_eq!(line, Some("is 7 d1=1 a1=0.25"));
        let (word, number, values) = line.and_then(parse).expect("a line");
        assert_eq!((word, number, values["a1"]), ("is", 7, 0.25));
        assert_eq!(unseal(sealed.replace("d1=1", "d1=0").as_bytes()), None);
        for bad in ["", "is", "is x", "is 7 d1", "is 7 a1=NaN", "is 7 a1=x"] {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }
}
