//! The settings of the driver: one server (`server: ADDRESS`) or several by name (`servers: {NAME: {address: …}}`).
//! Read once, when a driver is opened.

use std::net::SocketAddr;
use std::time::Duration;

use rcc_config::DeviceConfig;
use serde_json::Value;

use super::address::{self, Address, Form, Table};
use super::value::RegisterWords;
use rcc_driver_kit::driver::{DriverError, Settings};

/// Most servers per device.
pub const SERVERS_MAX: usize = 16;
/// Limits of one request: registers read, bits read, registers written, bits written (sections 6.1 to 6.12 of the
/// standard).
const REQUESTS_MAX: [u16; 4] = [125, 2000, 123, 1968];

/// Most points per request that a server accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestLimits {
    /// Registers per read, at most 125.
    pub read_registers: u16,
    /// Bits per read, at most 2000.
    pub read_bits: u16,
    /// Registers per write, at most 123.
    pub write_registers: u16,
    /// Coils per write, at most 1968.
    pub write_bits: u16,
    /// Most points without a channel that may be read along to combine two requests.
    pub gap: u16,
}

/// A raw value to write to an address.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// A coil, or a number in holding registers.
    pub address: Address,
    /// The registers; for a coil, the first is 0 or 1.
    pub words: RegisterWords,
}

/// Watchdog of the server: shows it that the driver is alive.
#[derive(Clone, Debug, PartialEq)]
pub struct Watchdog {
    /// A coil that is toggled, or a holding register that is incremented (from 65,535 to 0).
    pub address: Address,
    /// Interval between two writes.
    pub every: Duration,
}

/// Heartbeat of the device: shows that the program behind the server is running.
#[derive(Clone, Debug, PartialEq)]
pub struct Heartbeat {
    /// A bit or a register.
    pub address: Address,
    /// Time within which the value must change.
    pub within: Duration,
}

/// Settings of one server.
#[derive(Clone, Debug, PartialEq)]
pub struct ServerSettings {
    /// Name; `None` in the short form.
    pub name: Option<String>,
    /// Address of its socket.
    pub address: SocketAddr,
    /// Unit identifier.
    pub unit: u8,
    /// Time within which all inputs must have been read, or all outputs written.
    pub timeout: Duration,
    /// Longest pause between two connection attempts.
    pub back_off: Duration,
    /// Limits of a request.
    pub requests: RequestLimits,
    /// The server supports function 22; otherwise a bit of a register is written by reading and writing the register.
    pub mask_write: bool,
    /// Values written after each connect, in this order.
    pub on_connect: Vec<Assignment>,
    /// Watchdog that the driver writes.
    pub watchdog: Option<Watchdog>,
    /// Heartbeat that the driver reads.
    pub heartbeat: Option<Heartbeat>,
}

/// All settings of the driver.
#[derive(Clone, Debug, PartialEq)]
pub struct ModbusSettings {
    /// Interval between two exchanges.
    pub period: Duration,
    /// The servers in the order of the file: a single one without a name, or several with names.
    pub servers: Vec<ServerSettings>,
}

impl ModbusSettings {
    /// Reads the settings of `device`.
    ///
    /// # Errors
    /// Returns an error if a setting is missing, unknown or invalid.
    pub fn new(device: &DeviceConfig) -> Result<Self, DriverError> {
        let mut settings = Settings::of(device);
        let period = settings.duration("period", Duration::from_millis(10))?;
        let several = settings.read(
            "servers",
            "servers by name, such as {press: {address: \"10.0.0.5:502\", unit: 1}}, at most 16",
            Some(None),
            |value| {
                let servers = value.as_object()?;
                (1..=SERVERS_MAX)
                    .contains(&servers.len())
                    .then(|| Some(servers.clone()))
            },
        )?;
        let servers = match several {
            None => {
                let server = server(device, &mut settings, "server", period)?;
                vec![server]
            }
            Some(servers) => {
                let read = |(name, value): (&String, &Value)| named(device, name, value, period);
                servers.iter().map(read).collect::<Result<_, _>>()?
            }
        };
        settings.finish()?;
        Ok(Self { period, servers })
    }
}

fn named(
    device: &DeviceConfig,
    name: &str,
    value: &Value,
    period: Duration,
) -> Result<ServerSettings, DriverError> {
    let key = format!("servers.{name}");
    let first = name.starts_with(|letter: char| letter.is_ascii_lowercase());
    let rest =
        |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"_-".contains(&byte);
    if !first || !name.bytes().all(rest) || name.len() > 32 {
        return Err(setting(
            device,
            key,
            "invalid server name",
            "a name of small letters, digits, _ and -, beginning with a letter, at most 32",
        ));
    }
    let expected = "the settings of a server, such as {address: \"10.0.0.5:502\", unit: 1}";
    nested(device, &key, value, expected, |settings, inner| {
        let mut read = server(inner, settings, "address", period)?;
        read.name = Some(name.to_owned());
        Ok(read)
    })
}

fn server(
    device: &DeviceConfig,
    settings: &mut Settings<'_>,
    address: &'static str,
    period: Duration,
) -> Result<ServerSettings, DriverError> {
    let address = settings.address(address, None)?;
    let unit = settings.read("unit", "a unit number, 0 to 255", Some(255), |value| {
        u8::try_from(value.as_u64()?).ok()
    })?;
    let timeout = settings.duration("timeout", Duration::from_millis(100))?;
    let back_off = settings.duration("back_off", Duration::from_secs(2))?;
    let mask_write = settings.read("mask_write", "true or false", Some(true), Value::as_bool)?;
    let requests = part(
        device,
        settings,
        "requests",
        "such as {read_registers: 16}",
        requests,
    )?;
    let watchdog = part(
        device,
        settings,
        "watchdog",
        "such as {address: coil 15} or {address: holding 20, every: 50 ms}",
        |inner, settings| watchdog(inner, settings, period),
    )?;
    let heartbeat = part(
        device,
        settings,
        "heartbeat",
        "such as {address: input 9, within: 500 ms}",
        heartbeat,
    )?;
    let list = "a list such as [{address: holding 4384, value: 500}]";
    let values = settings.read("on_connect", list, Some(Vec::new()), |value| {
        value.as_array().cloned()
    })?;
    let mut on_connect = Vec::new();
    for (value, place) in values.iter().zip(0..) {
        let key = format!("on_connect.{place}");
        on_connect.push(nested(device, &key, value, list, |settings, inner| {
            assignment(inner, settings)
        })?);
    }
    Ok(ServerSettings {
        name: None,
        address,
        unit,
        timeout,
        back_off,
        requests: requests.unwrap_or(RequestLimits::STANDARD),
        mask_write,
        on_connect,
        watchdog,
        heartbeat,
    })
}

impl RequestLimits {
    /// The limits of the standard, without reading points that no channel uses.
    pub const STANDARD: RequestLimits = RequestLimits {
        read_registers: REQUESTS_MAX[0],
        read_bits: REQUESTS_MAX[1],
        write_registers: REQUESTS_MAX[2],
        write_bits: REQUESTS_MAX[3],
        gap: 0,
    };
}

fn requests(_: &DeviceConfig, settings: &mut Settings<'_>) -> Result<RequestLimits, DriverError> {
    let mut number = |key, expected, least: u64, most: u16, default| {
        settings.read(key, expected, Some(default), |value| {
            let number = value.as_u64().filter(|number| *number >= least)?;
            u16::try_from(number).ok().filter(|number| *number <= most)
        })
    };
    let [read_registers, read_bits, write_registers, write_bits] = REQUESTS_MAX;
    Ok(RequestLimits {
        read_registers: number(
            "read_registers",
            "a number from 1 to 125",
            1,
            read_registers,
            read_registers,
        )?,
        read_bits: number(
            "read_bits",
            "a number from 1 to 2000",
            1,
            read_bits,
            read_bits,
        )?,
        write_registers: number(
            "write_registers",
            "a number from 1 to 123",
            1,
            write_registers,
            write_registers,
        )?,
        write_bits: number(
            "write_bits",
            "a number from 1 to 1968",
            1,
            write_bits,
            write_bits,
        )?,
        gap: number("gap", "a number of points from 0 to 2000", 0, read_bits, 0)?,
    })
}

fn watchdog(
    _: &DeviceConfig,
    settings: &mut Settings<'_>,
    period: Duration,
) -> Result<Watchdog, DriverError> {
    let expected = "\"coil N\", which is toggled, or \"holding N\", which is counted up";
    let address = settings.read("address", expected, None, |value| {
        let address = own(value.as_str()?)?;
        let fits = address.table.is_writable() && is_plain(&address);
        fits.then_some(address)
    })?;
    let every = settings.duration("every", period)?;
    Ok(Watchdog { address, every })
}

fn heartbeat(_: &DeviceConfig, settings: &mut Settings<'_>) -> Result<Heartbeat, DriverError> {
    let expected = "a bit or a register that the device changes, such as \"input 9\"";
    let address = settings.read("address", expected, None, |value| {
        own(value.as_str()?).filter(is_plain)
    })?;
    let within = settings.duration("within", Duration::from_millis(500))?;
    Ok(Heartbeat { address, within })
}

fn assignment(_: &DeviceConfig, settings: &mut Settings<'_>) -> Result<Assignment, DriverError> {
    let expected = "\"coil N\" or \"holding N\" with a type";
    let address = settings.read("address", expected, None, |value| {
        let address = own(value.as_str()?)?;
        let fits = address.table.is_writable() && !matches!(address.form, Form::RegisterBit(_));
        fits.then_some(address)
    })?;
    let expected = "true or false for a coil, or a raw number that the registers hold";
    let words = settings.read("value", expected, None, |value| match address.form {
        Form::Number(format) => format.encode(value.as_f64()?),
        _ => Some([u16::from(value.as_bool()?), 0, 0, 0]),
    })?;
    Ok(Assignment { address, words })
}

/// Parses an address without a server name, which refers to the server with these settings.
fn own(text: &str) -> Option<Address> {
    address::parse(text)
        .ok()
        .filter(|address| address.server.is_none())
}

/// Returns true for one bit, or one whole register.
fn is_plain(address: &Address) -> bool {
    match address.form {
        Form::Bit => true,
        Form::RegisterBit(_) => false,
        Form::Number(_) => address.table != Table::Coil && address.width() == 1,
    }
}

/// Reads an object under an optional key.
fn part<T>(
    device: &DeviceConfig,
    settings: &mut Settings<'_>,
    key: &'static str,
    expected: &'static str,
    read: impl FnOnce(&DeviceConfig, &mut Settings<'_>) -> Result<T, DriverError>,
) -> Result<Option<T>, DriverError> {
    let value = settings.read(key, expected, Some(Value::Null), |value| {
        value.is_object().then(|| value.clone())
    })?;
    if value.is_null() {
        return Ok(None);
    }
    nested(device, key, &value, expected, |settings, inner| {
        read(inner, settings)
    })
    .map(Some)
}

/// Reads a nested object as settings; an error contains the full key.
fn nested<T>(
    device: &DeviceConfig,
    key: &str,
    value: &Value,
    expected: &'static str,
    read: impl FnOnce(&mut Settings<'_>, &DeviceConfig) -> Result<T, DriverError>,
) -> Result<T, DriverError> {
    if !value.is_object() {
        let cause = format!("invalid value {value}");
        return Err(setting(device, key.to_owned(), cause, expected));
    }
    let inner = DeviceConfig {
        settings: value.clone(),
        ..device.clone()
    };
    let mut settings = Settings::of(&inner);
    let result = read(&mut settings, &inner).and_then(|found| settings.finish().map(|()| found));
    result.map_err(|fault| match fault {
        DriverError::Setting {
            device,
            key: below,
            cause,
            expected,
        } => DriverError::Setting {
            device,
            key: format!("{key}.{below}"),
            cause,
            expected,
        },
        DriverError::UnknownSetting {
            device,
            key: below,
            known,
        } => DriverError::UnknownSetting {
            device,
            key: format!("{key}.{below}"),
            known,
        },
        other => other,
    })
}

fn setting(
    device: &DeviceConfig,
    key: String,
    cause: impl Into<String>,
    expected: &'static str,
) -> DriverError {
    DriverError::Setting {
        device: device.name.clone(),
        key,
        cause: cause.into(),
        expected,
    }
}
