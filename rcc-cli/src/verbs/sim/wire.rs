//! Channels in the words of the simulators' control ports: `io-sim` by Modbus table and address, `lwr-sim` by the number
//! of a KRL variable, `iiwa-sim` by the name of a signal. Pure.

use rcc_config::ChannelConfig;
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
pub fn write(driver: &str, channel: &ChannelConfig, value: f64) -> Result<Value, String> {
    let digital = channel.kind == ChannelKind::DigitalInput;
    let raw = (value - channel.offset) / channel.scale;
    match driver {
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
        "fri-iiwa" => Ok(json!({"set_io": {"name": channel.address, "value": raw}})),
        other => Err(format!(
            "no simulator of the driver `{other}` is known that can set inputs"
        )),
    }
}

/// Returns the value of a channel in the state of a simulator, in SI units; null if it is not there.
pub fn read(driver: &str, channel: &ChannelConfig, state: &Value) -> Value {
    let point = match driver {
        "modbus" => modbus(channel).and_then(|(table, address)| {
            let table = match table {
                "coil" => "coils",
                table => table,
            };
            state.get(table)?.get(address)
        }),
        "fri-lwr" => krl(channel, state),
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
