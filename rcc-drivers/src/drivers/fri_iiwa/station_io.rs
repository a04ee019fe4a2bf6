//! Channels of the device as inputs and outputs of the robot's station, which FRI names in every message.
//! Read at start; evaluated by the host's thread.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};

use super::robot_values::is_robot_value;
use crate::fri_iiwa::wire::schema::IoValue;
use crate::fri_iiwa::wire::{IO_MAX, IO_NAME_MAX, IoDirection, IoKind};
use rcc_driver_kit::driver::{
    DriverError, Inputs, Outputs, channel_error, channels, to_raw, to_si,
};

const EXPECTED: &str = "the name of the station's input or output, such as \"FRI.Out_Bool\", at most 63 bytes, that no other channel of this kind has; for an input also a value of the robot, such as \"interpolated 3\" or \"safety normal\"";

/// The channels of a device, and which of them the robot listed last.
#[derive(Clone, Debug)]
pub struct StationIo {
    rows: Vec<Row>,
}

#[derive(Clone, Debug)]
struct Row {
    name: String,
    kind: ChannelKind,
    /// Index among the channels of its kind.
    index: usize,
    config: ChannelConfig,
    /// Type and value that the robot listed last; `None`: it does not list it with this direction and a fitting type.
    listed: Option<(IoKind, f64)>,
}

impl StationIo {
    /// Reads the addresses of all channels.
    ///
    /// # Errors
    /// Returns an error for an address that is not a name, for an address that occurs twice, and for more channels than
    /// fit into a message.
    pub fn new(device: &DeviceConfig, supported: bool) -> Result<Self, DriverError> {
        let mut rows: Vec<Row> = Vec::new();
        for kind in [DigitalInput, DigitalOutput, AnalogInput, AnalogOutput] {
            for (index, channel) in channels(device, kind).into_iter().enumerate() {
                if is_robot_value(channel) {
                    continue;
                }
                let refuse = |cause: String| channel_error(device, channel, cause, EXPECTED);
                if !supported {
                    return Err(refuse("FRI 1.11 has no inputs and outputs".to_owned()));
                }
                let name = channel.address.as_str();
                let name = name.filter(|name| is_name(name));
                let Some(name) = name else {
                    return Err(refuse(format!("{} is not a name", channel.address)));
                };
                if let Some(other) = rows.iter().find(|row| row.name == name) {
                    let cause = format!("'{name}' is already used by '{}'", other.config.name);
                    return Err(refuse(cause));
                }
                if rows.len() == IO_MAX {
                    return Err(refuse(format!("a message has {IO_MAX} inputs and outputs")));
                }
                rows.push(Row {
                    name: name.to_owned(),
                    kind,
                    index,
                    config: channel.clone(),
                    listed: None,
                });
            }
        }
        Ok(Self { rows })
    }

    /// Takes over what the robot lists.
    pub fn read(&mut self, listed: &[IoValue]) {
        for row in &mut self.rows {
            let found = listed
                .iter()
                .find(|io| io.name.as_deref() == Some(&row.name));
            row.listed = found.and_then(|io| value(io, row.kind));
        }
    }

    /// Returns the first channel that the robot does not list.
    #[must_use]
    pub fn missing(&self) -> Option<&str> {
        let row = self.rows.iter().find(|row| row.listed.is_none());
        row.map(|row| row.name.as_str())
    }

    /// Copies the inputs; what the robot does not list is unknown.
    pub fn fill(&self, inputs: &mut Inputs) {
        (inputs.digital, inputs.digital_known) = (0, 0);
        inputs.analog.fill(f64::NAN);
        for row in &self.rows {
            let Some((_, raw)) = row.listed else { continue };
            match row.kind {
                DigitalInput => {
                    inputs.digital |= u64::from(raw != 0.0) << row.index;
                    inputs.digital_known |= 1 << row.index;
                }
                AnalogInput => {
                    if let Some(place) = inputs.analog.get_mut(row.index) {
                        *place = to_si(&row.config, raw);
                    }
                }
                DigitalOutput | AnalogOutput => {}
            }
        }
    }

    /// Returns the outputs that have a value and that the robot lists.
    #[must_use]
    pub fn write(&self, outputs: &Outputs) -> Vec<IoValue> {
        let rows = self.rows.iter();
        rows.filter_map(|row| row.written(outputs)).collect()
    }
}

/// Returns true for `Group.Name`.
fn is_name(text: &str) -> bool {
    let parts = text.split_once('.');
    text.len() <= IO_NAME_MAX
        && parts.is_some_and(|(group, name)| !group.is_empty() && !name.is_empty())
}

impl Row {
    fn written(&self, outputs: &Outputs) -> Option<IoValue> {
        let (kind, _) = self.listed?;
        let raw = match self.kind {
            DigitalOutput => (outputs.digital_set >> self.index & 1 == 1)
                .then(|| f64::from(u8::from(outputs.digital >> self.index & 1 == 1))),
            AnalogOutput => {
                let value = outputs.analog.get(self.index).copied();
                let value = value.filter(|value| value.is_finite());
                value.map(|value| to_raw(&self.config, value))
            }
            DigitalInput | AnalogInput => None,
        }?;
        let analog = kind == IoKind::Analog;
        // A whole number of the wire cannot be negative.
        if !analog && raw.round() < 0.0 {
            return None;
        }
        Some(IoValue {
            name: Some(self.name.clone()),
            kind: Some(kind as i32),
            direction: Some(IoDirection::Output as i32),
            digital: (!analog).then_some(raw.round() as u64),
            analog: analog.then_some(raw),
        })
    }
}

/// Returns type and raw value of what the robot lists, if direction and type fit the channel.
fn value(io: &IoValue, kind: ChannelKind) -> Option<(IoKind, f64)> {
    let direction = IoDirection::from_wire(io.direction?)?;
    let of = IoKind::from_wire(io.kind?)?;
    let output = matches!(kind, DigitalOutput | AnalogOutput);
    let digital = matches!(kind, DigitalInput | DigitalOutput);
    let fits = (direction == IoDirection::Output) == output && (of == IoKind::Boolean) == digital;
    let raw = match of {
        IoKind::Analog => io.analog?,
        IoKind::Boolean | IoKind::Digital => io.digital? as f64,
    };
    (fits && raw.is_finite()).then_some((of, raw))
}
