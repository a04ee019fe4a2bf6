//! Which points of its servers a device's channels are, and in how few requests they are read and written.
//! Built once, when a driver is opened; used by the host's thread.

use rcc_config::{ChannelConfig, DeviceConfig, OnRelease};
use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX};
use rcc_core::primitive::ChannelKind;

use super::address::{self, Address, Form, Table};
use super::settings::ServerSettings;
use super::value::{RegisterFormat, RegisterWords};
use crate::driver::{DriverError, Outputs, channel_error, to_raw, to_si};

mod check;

use check::{check_output, check_size};

/// What a read value is for.
#[derive(Clone, Debug)]
pub enum InputTarget {
    /// Digital input `index`, a point of a table of bits.
    Bit {
        /// Place among the digital inputs.
        index: usize,
    },
    /// Digital input `index`, a bit of a register.
    RegisterBit {
        /// Place among the digital inputs.
        index: usize,
        /// NumberType of the bit.
        bit: u8,
    },
    /// Analog input `index`.
    Number {
        /// Place among the analog inputs.
        index: usize,
        /// How its registers are read.
        format: RegisterFormat,
        /// Scale, offset.
        config: ChannelConfig,
    },
    /// The device's heartbeat.
    Heartbeat,
}

/// One value of a read.
#[derive(Clone, Debug)]
pub struct ReadItem {
    /// Its first point, counted from the first one of the read.
    pub at: usize,
    /// What it is for.
    pub target: InputTarget,
    /// The channel's name.
    pub name: String,
}

/// One request that reads.
#[derive(Clone, Debug)]
pub struct ReadBlock {
    /// From which table.
    pub table: Table,
    /// First point.
    pub first: u16,
    /// NumberType of points.
    pub count: u16,
    /// What it brings.
    pub items: Vec<ReadItem>,
}

/// Where the value of an output comes from.
#[derive(Clone, Debug)]
pub enum OutputSource {
    /// Digital output `index`.
    Coil {
        /// Place among the digital outputs.
        index: usize,
    },
    /// Digital outputs that are bits of one register.
    Bits {
        /// NumberType of the bit, and place among the digital outputs.
        bits: Vec<(u8, usize)>,
    },
    /// Analog output `index`.
    Number {
        /// Place among the analog outputs.
        index: usize,
        /// How its registers are written.
        format: RegisterFormat,
        /// Scale, offset.
        config: ChannelConfig,
    },
}

/// What an output is written to.
#[derive(Clone, Debug)]
pub struct OutputPoint {
    /// Coil or holding.
    pub table: Table,
    /// First point.
    pub address: u16,
    /// Where its value comes from.
    pub source: OutputSource,
    /// The channel's name, or several.
    pub name: String,
}

/// A raw value of an output: bits outside of `mask` are not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawOutput {
    /// Registers; the first is 0 or 1 for a coil.
    pub words: RegisterWords,
    /// Which bits of the first register count; all of a number, 1 of a coil.
    pub mask: u16,
}

impl RawOutput {
    /// The bits that must be written so that what `self` holds becomes `wanted`.
    #[must_use]
    pub fn changes(&self, wanted: &RawOutput) -> u16 {
        let same = self.mask & !(self.words[0] ^ wanted.words[0]);
        if wanted.mask == u16::MAX && (same != u16::MAX || self.words != wanted.words) {
            return u16::MAX;
        }
        wanted.mask & !same
    }
}

/// What is to be written to an output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DesiredValue {
    /// Nothing: the device keeps what it has.
    Nothing,
    /// This.
    Value(RawOutput),
    /// This SI value, which the registers cannot hold.
    Unfit(f64),
}

/// What is read from one server, and what is written to it.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// In order of table and address.
    pub reads: Vec<ReadBlock>,
    /// In order of table and address.
    pub outputs: Vec<OutputPoint>,
}

/// A channel and where it is.
struct AddressedChannel<'a> {
    channel: &'a ChannelConfig,
    address: Address,
}

/// The outputs of a device that nobody commands: safe values; one that holds has none.
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
    /// The points of each server, in the order of `servers`.
    ///
    /// # Errors
    /// An address of another form, of another server, or that two outputs share; a number that the registers, or one
    /// request, cannot hold.
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

/// Whose channel it is, and where.
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
    let text = text.ok_or_else(|| fault(format!("{} is no such address", channel.address)))?;
    let address = address::parse(text)
        .map_err(|error| fault(format!("\"{text}\" is no such address: {error}")))?;
    let analog = matches!(address.form, Form::Number(_));
    let fits = match channel.kind {
        ChannelKind::DigitalInput => !analog,
        ChannelKind::DigitalOutput => !analog && address.table.is_writable(),
        ChannelKind::AnalogInput => analog,
        ChannelKind::AnalogOutput => analog && address.table.is_writable(),
    };
    if !fits {
        return Err(fault(format!("\"{text}\" is no such address")));
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
                "\"{text}\" does not say of which server ({names}), such as \"NAME/{text}\""
            ),
            (Some(server), "") => {
                format!("there is no server '{server}', as settings.server is the only one")
            }
            (Some(server), names) => {
                format!("there is no server '{server}' in settings.servers; there are: {names}")
            }
        })
    })?;
    Ok((position, address))
}

/// As few reads as the server's limits allow.
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
                // Within `most`.
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

/// In order, with the bits of one register in one place.
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
    /// Points that it takes.
    #[must_use]
    pub fn width(&self) -> u16 {
        match &self.source {
            OutputSource::Coil { .. } | OutputSource::Bits { .. } => 1,
            OutputSource::Number { format, .. } => format.width(),
        }
    }

    /// What `outputs` want it to be.
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
                // Without a value it is NaN.
                _ => DesiredValue::Nothing,
            },
        }
    }
}

impl InputTarget {
    /// SI value of registers; NaN if they hold none, or one outside of the channel's range.
    #[must_use]
    pub fn number(format: RegisterFormat, config: &ChannelConfig, registers: &[u16]) -> f64 {
        let value = to_si(config, format.decode(registers));
        match config.range {
            Some([lower, upper]) if !(value >= lower && value <= upper) => f64::NAN,
            _ if value.is_finite() => value,
            _ => f64::NAN,
        }
    }
}
