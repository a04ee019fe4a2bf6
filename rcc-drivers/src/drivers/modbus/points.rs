//! Which points of a Modbus server a device's channels are, and how they are read and written in few transactions.
//! Built once; used by the host's thread.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind;

use crate::driver::{DriverError, channel_error, to_raw, to_si};

/// Most points of one transaction; the standard allows 125 registers and 2000 bits.
const RUN_MAX: usize = 120;

/// The tables of a Modbus server.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Table {
    /// Bits, read and written.
    Coil,
    /// Bits, read only.
    Discrete,
    /// 16 bits, read and written.
    Holding,
    /// 16 bits, read only.
    Input,
}

/// A channel and its point.
#[derive(Clone, Debug)]
pub struct Point {
    /// Place among the channels of its kind.
    pub index: usize,
    /// Where it is.
    pub table: Table,
    /// Number in its table, from 0.
    pub address: u16,
    /// A register holds a two's complement.
    signed: bool,
    config: ChannelConfig,
}

/// The points of one device, each list by table and address.
#[derive(Clone, Debug)]
pub struct Points {
    /// Digital inputs.
    pub digital_inputs: Vec<Point>,
    /// Digital outputs.
    pub digital_outputs: Vec<Point>,
    /// Analog inputs.
    pub analog_inputs: Vec<Point>,
    /// Analog outputs.
    pub analog_outputs: Vec<Point>,
}

impl Points {
    /// The points that the channels of `device` name.
    ///
    /// # Errors
    /// An address of another form, one that two outputs share, or an analog output that 16 bits cannot hold.
    pub fn new(device: &DeviceConfig) -> Result<Self, DriverError> {
        Ok(Self {
            digital_inputs: points(
                device,
                ChannelKind::DigitalInput,
                &[Table::Discrete, Table::Coil],
                "\"discrete N\" or \"coil N\", N from 0",
            )?,
            digital_outputs: points(
                device,
                ChannelKind::DigitalOutput,
                &[Table::Coil],
                "\"coil N\", N from 0, that no other output has",
            )?,
            analog_inputs: points(
                device,
                ChannelKind::AnalogInput,
                &[Table::Input, Table::Holding],
                "\"input N\" or \"holding N\", N from 0, with \"i16\" after it if the register has a sign",
            )?,
            analog_outputs: points(
                device,
                ChannelKind::AnalogOutput,
                &[Table::Holding],
                "\"holding N\", N from 0, that no other output has, with \"i16\" after it if the register has a sign",
            )?,
        })
    }
}

impl Point {
    /// SI value of a register.
    #[must_use]
    pub fn value(&self, register: u16) -> f64 {
        let raw = if self.signed {
            f64::from(register.cast_signed())
        } else {
            f64::from(register)
        };
        to_si(&self.config, raw)
    }

    /// The register that holds an SI value, rounded; `None` if 16 bits cannot hold it.
    #[must_use]
    pub fn register(&self, value: f64) -> Option<u16> {
        let raw = to_raw(&self.config, value).round();
        let (lower, upper) = if self.signed {
            (f64::from(i16::MIN), f64::from(i16::MAX))
        } else {
            (0.0, f64::from(u16::MAX))
        };
        // Inside of the bounds, so nothing is cut off.
        (raw >= lower && raw <= upper).then(|| {
            if self.signed {
                (raw as i16).cast_unsigned()
            } else {
                raw as u16
            }
        })
    }
}

/// Splits points into runs of consecutive addresses of one table: one transaction each.
pub fn runs<T: AsRef<Point>>(points: &[T]) -> impl Iterator<Item = &[T]> {
    let mut rest = points;
    std::iter::from_fn(move || {
        let first = rest.first()?.as_ref();
        let length = rest
            .iter()
            .zip(0..RUN_MAX)
            .take_while(|(point, place)| {
                let point = point.as_ref();
                point.table == first.table
                    && usize::from(point.address) == usize::from(first.address) + place
            })
            .count();
        let (run, others) = rest.split_at(length.max(1));
        rest = others;
        Some(run)
    })
}

impl AsRef<Point> for Point {
    fn as_ref(&self) -> &Point {
        self
    }
}

fn points(
    device: &DeviceConfig,
    kind: ChannelKind,
    tables: &[Table],
    expected: &'static str,
) -> Result<Vec<Point>, DriverError> {
    let analog = matches!(kind, ChannelKind::AnalogInput | ChannelKind::AnalogOutput);
    let output = matches!(kind, ChannelKind::AnalogOutput | ChannelKind::DigitalOutput);
    let mut points: Vec<Point> = Vec::new();
    for (index, channel) in device.channels_of(kind).enumerate() {
        let address = channel
            .address
            .as_str()
            .and_then(|text| parse(text, analog));
        let Some((table, address, signed)) = address.filter(|(table, ..)| tables.contains(table))
        else {
            let cause = format!("{} is no such address", channel.address);
            return Err(channel_error(device, channel, cause, expected));
        };
        let point = Point {
            index,
            table,
            address,
            signed,
            config: channel.clone(),
        };
        let same = |other: &&Point| (other.table, other.address) == (table, address);
        if let Some(other) = points.iter().find(same).filter(|_| output) {
            let cause = format!("'{}' is at the same address", other.config.name);
            return Err(channel_error(device, channel, cause, expected));
        }
        if kind == ChannelKind::AnalogOutput {
            check_range(device, channel, &point)?;
        }
        points.push(point);
    }
    points.sort_by_key(|point| (point.table, point.address));
    Ok(points)
}

/// Every value that may be commanded must fit: nothing is cut off later.
fn check_range(
    device: &DeviceConfig,
    channel: &ChannelConfig,
    point: &Point,
) -> Result<(), DriverError> {
    let fits = channel
        .range
        .is_some_and(|range| range.iter().all(|value| point.register(*value).is_some()));
    if fits {
        return Ok(());
    }
    let cause = match channel.range {
        None => "an analog output of 16 bits needs a range".to_owned(),
        Some([lower, upper]) => format!("the range {lower} to {upper} (SI) does not fit 16 bits"),
    };
    let expected = "a `range` that fits the register with this scale and offset (\"i16\" in the address gives a sign)";
    Err(channel_error(device, channel, cause, expected))
}

/// `coil 3`, `holding 2 i16`.
fn parse(text: &str, analog: bool) -> Option<(Table, u16, bool)> {
    let mut words = text.split_whitespace();
    let table = match words.next()? {
        "coil" => Table::Coil,
        "discrete" => Table::Discrete,
        "holding" => Table::Holding,
        "input" => Table::Input,
        _ => return None,
    };
    let address = words.next()?.parse().ok()?;
    let signed = match words.next() {
        None => false,
        Some("u16") if analog => false,
        Some("i16") if analog => true,
        Some(_) => return None,
    };
    words.next().is_none().then_some((table, address, signed))
}
