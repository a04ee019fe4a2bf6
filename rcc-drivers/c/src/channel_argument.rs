//! The channels of a device as C is told of them: addresses as text, values raw.
//! Used once, when the driver is opened.

use std::ffi::CString;

use rcc_driver_kit::driver::{DriverError, channel_error, to_raw};
use rcc_driver_kit::rcc_config::device::{CHANNEL_KINDS, is_digital, is_output};
use rcc_driver_kit::rcc_config::{ChannelConfig, DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::message::{ANALOG_MAX, DIGITAL_MAX};
use rcc_driver_kit::serde_json::Value;

use crate::ffi::{ChannelArgument, Description};

/// Returns the channels, by kind in the order of [`CHANNEL_KINDS`], which is that of the header.
///
/// # Errors
/// Returns an error for an address that is neither an integer nor a text, and for two outputs at one address.
pub fn read(
    table: &Description,
    device: &DeviceConfig,
) -> Result<Vec<ChannelArgument>, DriverError> {
    let mut found = Vec::new();
    for (kind, number) in CHANNEL_KINDS.into_iter().zip(0..) {
        let most = match is_digital(kind) {
            true => DIGITAL_MAX,
            false => ANALOG_MAX,
        };
        let mut outputs: Vec<&ChannelConfig> = Vec::new();
        for (channel, index) in device.channels_of(kind).take(most).zip(0..) {
            let fault = |cause| channel_error(device, channel, cause, table.address);
            let unusable = || fault(format!("invalid address {}", channel.address));
            if is_output(kind) {
                let twin = outputs
                    .iter()
                    .find(|other| other.address == channel.address);
                if let Some(twin) = twin {
                    let (address, name) = (&channel.address, &twin.name);
                    return Err(fault(format!(
                        "address {address} is already used by '{name}'"
                    )));
                }
                outputs.push(channel);
            }
            found.push(ChannelArgument {
                name: CString::new(channel.name.as_str()).map_err(|_| unusable())?,
                address: text(&channel.address).ok_or_else(unusable)?,
                kind: number,
                index,
                released: released(channel),
            });
        }
    }
    Ok(found)
}

fn text(address: &Value) -> Option<CString> {
    let text = match address {
        Value::String(text) if !text.is_empty() => text.clone(),
        Value::Number(number) if number.is_i64() || number.is_u64() => number.to_string(),
        _ => return None,
    };
    CString::new(text).ok()
}

/// Returns the raw value of an output that no net commands; NaN: it keeps its last one, or it is an input.
fn released(channel: &ChannelConfig) -> f64 {
    match channel.on_release {
        Some(OnRelease::Safe(value)) if is_digital(channel.kind) => value,
        Some(OnRelease::Safe(value)) => to_raw(channel, value),
        Some(OnRelease::Hold) | None => f64::NAN,
    }
}
