//! Maps a device's channels to points of its servers, and combines them into few requests.
//! Built once, when a driver is opened; used by the host's thread.

use rcc_config::{ChannelConfig, DeviceConfig, OnRelease};
use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX};
use rcc_core::primitive::ChannelKind;

use super::address::{self, Address, Form, Table};
use super::settings::ServerSettings;
use super::value::{RegisterFormat, RegisterWords};
use rcc_driver_kit::driver::{DriverError, Outputs, channel_error, to_raw, to_si};

mod check;

use check::{check_output, check_size};

/// Destination of a value that is read.
#[derive(Clone, Debug)]
pub enum InputTarget {
    /// Digital input `index`, from a table of bits.
    Bit {
        /// Index among the digital inputs.
        index: usize,
    },
    /// Digital input `index`, from a bit of a register.
    RegisterBit {
        /// Index among the digital inputs.
        index: usize,
        /// Number of the bit.
        bit: u8,
    },
    /// Analog input `index`.
    Number {
        /// Index among the analog inputs.
        index: usize,
        /// Format of its registers.
        format: RegisterFormat,
        /// Configuration of the channel: scale, offset, range.
        config: ChannelConfig,
    },
    /// Heartbeat of the device.
    Heartbeat,
}

/// One value of a read request.
#[derive(Clone, Debug)]
pub struct ReadItem {
    /// Offset of its first point from the first point of the read.
    pub at: usize,
    /// Destination of the value.
    pub target: InputTarget,
    /// Name of the channel.
    pub name: String,
}

/// One read request.
#[derive(Clone, Debug)]
pub struct ReadBlock {
    /// Table to read from.
    pub table: Table,
    /// First point.
    pub first: u16,
    /// Number of points.
    pub count: u16,
    /// Values that it contains.
    pub items: Vec<ReadItem>,
}

/// Source of an output's value.
#[derive(Clone, Debug)]
pub enum OutputSource {
    /// Digital output `index`.
    Coil {
        /// Index among the digital outputs.
        index: usize,
    },
    /// Digital outputs that are bits of one register.
    Bits {
        /// Number of each bit, and its index among the digital outputs.
        bits: Vec<(u8, usize)>,
    },
    /// Analog output `index`.
    Number {
        /// Index among the analog outputs.
        index: usize,
        /// Format of its registers.
        format: RegisterFormat,
        /// Configuration of the channel: scale, offset, range.
        config: ChannelConfig,
    },
}

/// An output and the points that it is written to.
#[derive(Clone, Debug)]
pub struct OutputPoint {
    /// Coils or holding registers.
    pub table: Table,
    /// First point.
    pub address: u16,
    /// Source of its value.
    pub source: OutputSource,
    /// Name of the channel, or of several channels.
    pub name: String,
}

/// Raw value of an output; bits outside `mask` are unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawOutput {
    /// Registers; for a coil, the first is 0 or 1.
    pub words: RegisterWords,
    /// Valid bits of the first register: all for a number, 1 for a coil.
    pub mask: u16,
}

impl RawOutput {
    /// Returns the bits that must be written to change `self` into `wanted`.
    #[must_use]
    pub fn changes(&self, wanted: &RawOutput) -> u16 {
        let same = self.mask & !(self.words[0] ^ wanted.words[0]);
        if wanted.mask == u16::MAX && (same != u16::MAX || self.words != wanted.words) {
            return u16::MAX;
        }
        wanted.mask & !same
    }
}

/// Value to write to an output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DesiredValue {
    /// No value: the device keeps its present one.
    Nothing,
    /// This raw value.
    Value(RawOutput),
    /// This SI value, which the registers cannot hold.
    Unfit(f64),
}

/// The read requests and outputs of one server.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Sorted by table and address.
    pub reads: Vec<ReadBlock>,
    /// Sorted by table and address.
    pub outputs: Vec<OutputPoint>,
}

/// A channel with its address.
struct AddressedChannel<'a> {
    channel: &'a ChannelConfig,
    address: Address,
}

/// Returns the outputs of a device without commands: safe values, and no value for channels that hold.
#[must_use]
pub fn released(device: &DeviceConfig) -> Outputs {
    let mut outputs = Outputs::NONE;
    for channel in &device.channels {
        let Some(OnRelease::Safe(value)) = channel.on_release else {
            continue;
        };
        let index = channel.index as usize;
        match channel.kind {
            ChannelKind::DigitalOutput if index < DIGITAL_MAX => {
                outputs.digital_set |= 1 << index;
                outputs.digital |= u64::from(value != 0.0) << index;
            }
            ChannelKind::AnalogOutput if index < ANALOG_MAX => outputs.analog[index] = value,
            _ => {}
        }
    }
    outputs
}

impl Points {
    /// Returns the points of each server, in the order of `servers`.
    ///
    /// # Errors
    /// Returns an error for an invalid address, an unknown server, an address that two outputs share, or a number that
    /// does not fit into its registers or into one request.
    pub fn new(
        device: &DeviceConfig,
        servers: &[ServerSettings],
    ) -> Result<Vec<Points>, DriverError> {
        let mut inputs: Vec<Vec<AddressedChannel<'_>>> =
            servers.iter().map(|_| Vec::new()).collect();
        let mut outputs: Vec<Vec<AddressedChannel<'_>>> =
            servers.iter().map(|_| Vec::new()).collect();
        for channel in &device.channels {
            let (place, address) = place(device, channel, servers)?;
            let output = matches!(
                channel.kind,
                ChannelKind::DigitalOutput | ChannelKind::AnalogOutput
            );
            let lists = if output { &mut outputs } else { &mut inputs };
            if output {
                check_output(device, channel, &address, &lists[place])?;
            }
            check_size(device, channel, &address, output, servers[place].requests)?;
            lists[place].push(AddressedChannel { channel, address });
        }
        let lists = inputs.into_iter().zip(outputs).zip(servers);
        Ok(lists
            .map(|((inputs, outputs), server)| Points {
                reads: reads(inputs, server),
                outputs: merge(outputs),
            })
            .collect())
    }
}

/// Returns the index of a channel's server, and its address there.
fn place(
    device: &DeviceConfig,
    channel: &ChannelConfig,
    servers: &[ServerSettings],
) -> Result<(usize, Address), DriverError> {
    let expected = match channel.kind {
        ChannelKind::DigitalInput => {
            "\"discrete N\", \"coil N\", \"input N bit B\" or \"holding N bit B\", N from 0"
        }
        ChannelKind::DigitalOutput => "\"coil N\" or \"holding N bit B\", N from 0",
        ChannelKind::AnalogInput => {
            "\"input N\" or \"holding N\", N from 0, and a type unless it is u16, such as \"input 4 f32 CDAB\""
        }
        ChannelKind::AnalogOutput => {
            "\"holding N\", N from 0, and a type unless it is u16, such as \"holding 4 i16\""
        }
    };
    let fault = |cause: String| channel_error(device, channel, cause, expected);
    let text = channel.address.as_str();
    let text = text.ok_or_else(|| fault(format!("{} is not a valid address", channel.address)))?;
    let address = address::parse(text)
        .map_err(|error| fault(format!("\"{text}\" is not a valid address: {error}")))?;
    let analog = matches!(address.form, Form::Number(_));
    let fits = match channel.kind {
        ChannelKind::DigitalInput => !analog,
        ChannelKind::DigitalOutput => !analog && address.table.is_writable(),
        ChannelKind::AnalogInput => analog,
        ChannelKind::AnalogOutput => analog && address.table.is_writable(),
    };
    if !fits {
        return Err(fault(format!("\"{text}\" is not a valid address")));
    }
    let position = servers
        .iter()
        .position(|server| server.name == address.server);
    let names = || {
        let names = servers.iter().filter_map(|server| server.name.as_deref());
        names.collect::<Vec<_>>().join(", ")
    };
    let position = position.ok_or_else(|| {
        fault(match (&address.server, names().as_str()) {
            (None, names) => format!(
                "\"{text}\" does not name its server ({names}): write for example \"NAME/{text}\""
            ),
            (Some(server), "") => {
                format!("unknown server '{server}': the only server is that of settings.server")
            }
            (Some(server), names) => {
                format!("unknown server '{server}'; servers in settings.servers: {names}")
            }
        })
    })?;
    Ok((position, address))
}

/// Combines inputs into as few read requests as the server's limits allow.
fn reads(inputs: Vec<AddressedChannel<'_>>, server: &ServerSettings) -> Vec<ReadBlock> {
    let channel = |AddressedChannel { channel, address }: AddressedChannel<'_>| {
        let index = channel.index as usize;
        let target = match address.form {
            Form::Bit => InputTarget::Bit { index },
            Form::RegisterBit(bit) => InputTarget::RegisterBit { index, bit },
            Form::Number(format) => InputTarget::Number {
                index,
                format,
                config: channel.clone(),
            },
        };
        (address, target, channel.name.clone())
    };
    let mut items: Vec<(Address, InputTarget, String)> = inputs.into_iter().map(channel).collect();
    if let Some(heartbeat) = &server.heartbeat {
        let name = "heartbeat".to_owned();
        items.push((heartbeat.address.clone(), InputTarget::Heartbeat, name));
    }
    items.sort_by_key(|(address, ..)| (address.table, address.number));
    let mut reads: Vec<ReadBlock> = Vec::new();
    for (address, target, name) in items {
        let (table, number) = (address.table, address.number);
        let most = if table.is_bits() {
            server.requests.read_bits
        } else {
            server.requests.read_registers
        };
        let end = u32::from(number) + u32::from(address.width());
        let joins = |read: &&mut ReadBlock| {
            let hole =
                u32::from(number).saturating_sub(u32::from(read.first) + u32::from(read.count));
            read.table == table
                && hole <= u32::from(server.requests.gap)
                && end - u32::from(read.first) <= u32::from(most)
        };
        match reads.last_mut().filter(joins) {
            Some(read) => {
                // At most `most`.
                read.count = read.count.max((end - u32::from(read.first)) as u16);
                read.items.push(ReadItem {
                    at: usize::from(number - read.first),
                    target,
                    name,
                });
            }
            None => reads.push(ReadBlock {
                table,
                first: number,
                count: address.width(),
                items: vec![ReadItem {
                    at: 0,
                    target,
                    name,
                }],
            }),
        }
    }
    reads
}

/// Sorts the outputs and combines the bits of one register.
fn merge(mut placed: Vec<AddressedChannel<'_>>) -> Vec<OutputPoint> {
    placed.sort_by_key(|output| (output.address.table, output.address.number));
    let mut outputs: Vec<OutputPoint> = Vec::new();
    for AddressedChannel { channel, address } in placed {
        let index = channel.index as usize;
        let source = match address.form {
            Form::Bit => OutputSource::Coil { index },
            Form::Number(format) => OutputSource::Number {
                index,
                format,
                config: channel.clone(),
            },
            Form::RegisterBit(bit) => {
                if let Some(last) = outputs.last_mut()
                    && last.address == address.number
                    && let OutputSource::Bits { bits } = &mut last.source
                {
                    bits.push((bit, index));
                    last.name = format!("{}, {}", last.name, channel.name);
                    continue;
                }
                OutputSource::Bits {
                    bits: vec![(bit, index)],
                }
            }
        };
        outputs.push(OutputPoint {
            table: address.table,
            address: address.number,
            source,
            name: channel.name.clone(),
        });
    }
    outputs
}

impl OutputPoint {
    /// Returns the number of points of the output.
    #[must_use]
    pub fn width(&self) -> u16 {
        match &self.source {
            OutputSource::Coil { .. } | OutputSource::Bits { .. } => 1,
            OutputSource::Number { format, .. } => format.width(),
        }
    }

    /// Returns the value that `outputs` require.
    #[must_use]
    pub fn desired(&self, outputs: &Outputs) -> DesiredValue {
        let digital = |index: usize| {
            let set = outputs.digital_set >> index & 1 == 1;
            set.then_some(outputs.digital >> index & 1 == 1)
        };
        match &self.source {
            OutputSource::Coil { index } => match digital(*index) {
                None => DesiredValue::Nothing,
                Some(on) => DesiredValue::Value(RawOutput {
                    words: [u16::from(on), 0, 0, 0],
                    mask: 1,
                }),
            },
            OutputSource::Bits { bits } => {
                let mut raw = RawOutput::default();
                for (bit, index) in bits {
                    if let Some(on) = digital(*index) {
                        raw.mask |= 1 << bit;
                        raw.words[0] |= u16::from(on) << bit;
                    }
                }
                if raw.mask == 0 {
                    DesiredValue::Nothing
                } else {
                    DesiredValue::Value(raw)
                }
            }
            OutputSource::Number {
                index,
                format,
                config,
            } => match outputs.analog.get(*index) {
                Some(value) if !value.is_nan() => match format.encode(to_raw(config, *value)) {
                    Some(words) => DesiredValue::Value(RawOutput {
                        words,
                        mask: u16::MAX,
                    }),
                    None => DesiredValue::Unfit(*value),
                },
                // NaN means no value.
                _ => DesiredValue::Nothing,
            },
        }
    }
}

impl InputTarget {
    /// Returns the SI value of registers; NaN if it is not finite, or outside the channel's range.
    #[must_use]
    pub fn number(format: RegisterFormat, config: &ChannelConfig, registers: &[u16]) -> f64 {
        to_si(config, format.decode(registers))
    }
}
