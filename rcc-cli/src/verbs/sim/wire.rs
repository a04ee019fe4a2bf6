//! Channels in the words of the simulators' control ports: `io-sim` by Modbus table and address, `lwr-sim` by the number
//! of a KRL variable, `iiwa-sim` by the name of a signal, `ethercat-sim` by terminal and channel. Pure.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind;
use serde_json::{Value, json};

/// Request for the whole state; every simulator understands it.
pub fn state() -> Value {
    json!("state")
}

/// Returns the command that sets an input to `value`: 0 or 1, or an SI value.
///
/// # Errors
/// Returns why the simulator of this driver cannot set the channel.
pub fn write(device: &DeviceConfig, channel: &ChannelConfig, value: f64) -> Result<Value, String> {
    let driver = device.driver.to_string();
    let digital = channel.kind == ChannelKind::DigitalInput;
    let raw = (value - channel.offset) / channel.scale;
    match driver.as_str() {
        "modbus" => {
            let (point, address) = modbus(channel).ok_or_else(|| {
                format!(
                    "the control port of io-sim sets whole points only, and the address is {}",
                    channel.address
                )
            })?;
            if digital {
                return Ok(json!({"set": {point: {"address": address, "value": value != 0.0}}}));
            }
            let raw = raw.round();
            if !(0.0..=f64::from(u16::MAX)).contains(&raw) {
                return Err(format!("{value} does not fit into its register"));
            }
            Ok(json!({"set": {point: {"address": address, "value": raw as u16}}}))
        }
        "fri-lwr" if digital => {
            Ok(json!({"set_bool": {"number": channel.address, "value": value != 0.0}}))
        }
        "fri-lwr" => Ok(json!({"set_real": {"number": channel.address, "value": raw}})),
        "ethercat" => {
            let (terminal, place) = ethercat(device, channel).ok_or_else(|| {
                format!(
                    "the control port of ethercat-sim sets channels only, and the address is {}",
                    channel.address
                )
            })?;
            // Beyond 16 bits it is an over- or underrange.
            let raw = raw.round() as i32;
            Ok(json!({"set": {"terminal": terminal + 1, "channel": place + 1, "value": raw}}))
        }
        "fri-iiwa" => Ok(json!({"set_io": {"name": channel.address, "value": raw}})),
        other => Err(format!(
            "no simulator of the driver `{other}` is known that can set inputs"
        )),
    }
}

/// Returns the value of a channel in the state of a simulator, in SI units; null if it is not there.
pub fn read(device: &DeviceConfig, channel: &ChannelConfig, state: &Value) -> Value {
    let point = match device.driver.to_string().as_str() {
        "modbus" => modbus(channel).and_then(|(table, address)| {
            let table = match table {
                "coil" => "coils",
                table => table,
            };
            state.get(table)?.get(address)
        }),
        "fri-lwr" => krl(channel, state),
        "ethercat" => {
            let value = ethercat(device, channel).and_then(|(terminal, place)| {
                let list = match rcc_config::device::is_output(channel.kind) {
                    true => "outputs",
                    false => "inputs",
                };
                state.get("terminals")?.get(terminal)?.get(list)?.get(place)
            });
            if rcc_config::device::is_digital(channel.kind) {
                return value.map_or(Value::Null, |value| json!(value != &json!(0)));
            }
            value
        }
        _ => None,
    };
    match point {
        Some(Value::Number(number)) => number.as_f64().map_or(Value::Null, |raw| {
            json!(raw * channel.scale + channel.offset)
        }),
        Some(Value::Bool(value)) => json!(value),
        _ => Value::Null,
    }
}

/// Returns table and address of `TABLE NUMBER`; `None` for other servers, other types and bits of registers.
fn modbus(channel: &ChannelConfig) -> Option<(&str, usize)> {
    let (table, address) = channel.address.as_str()?.split_once(' ')?;
    let known = ["coil", "discrete", "holding", "input"].contains(&table);
    address
        .parse()
        .ok()
        .filter(|_| known)
        .map(|address| (table, address))
}

/// Returns position and channel, both from 0, of `TERMINAL channel N`, or of `TERMINAL bit N` of a digital terminal.
fn ethercat(device: &DeviceConfig, channel: &ChannelConfig) -> Option<(usize, usize)> {
    let words: Vec<&str> = channel.address.as_str()?.split_whitespace().collect();
    let [terminal, form, number] = words[..] else {
        return None;
    };
    let position = device.settings["terminals"][terminal]["position"].as_u64()?;
    let number: usize = number.parse().ok()?;
    let place = match form {
        "channel" => number.checked_sub(1)?,
        "bit" => number,
        _ => return None,
    };
    Some((usize::try_from(position.checked_sub(1)?).ok()?, place))
}

fn krl<'s>(channel: &ChannelConfig, state: &'s Value) -> Option<&'s Value> {
    let (block, list) = match channel.kind {
        ChannelKind::DigitalInput => ("krl_to_pc", "booleans"),
        ChannelKind::DigitalOutput => ("krl_from_pc", "booleans"),
        ChannelKind::AnalogInput => ("krl_to_pc", "reals"),
        ChannelKind::AnalogOutput => ("krl_from_pc", "reals"),
    };
    let row = channel.address.as_u64()?.checked_sub(1)?;
    state.get(block)?.get(list)?.get(usize::try_from(row).ok()?)
}
