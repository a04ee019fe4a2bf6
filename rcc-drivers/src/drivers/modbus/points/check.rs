//! Checks of a channel's address before the first request.
//! Used once, when a driver is opened.

use rcc_config::{ChannelConfig, DeviceConfig};

use super::super::address::{Address, Form};
use super::super::settings::RequestLimits;
use super::AddressedChannel;
use rcc_driver_kit::driver::{DriverError, channel_error, to_raw};

/// Checks that the channel's values fit into its registers, and that no other output uses them.
pub(super) fn check_output(
    device: &DeviceConfig,
    channel: &ChannelConfig,
    address: &Address,
    others: &[AddressedChannel<'_>],
) -> Result<(), DriverError> {
    if let Some(other) = others.iter().find(|other| overlap(&other.address, address)) {
        let cause = format!(
            "\"{address}\" and \"{}\" of '{}' overlap, and both are written",
            other.address, other.channel.name
        );
        let expected = "a separate address for every output";
        return Err(channel_error(device, channel, cause, expected));
    }
    let Form::Number(format) = address.form else {
        return Ok(());
    };
    let number = format.number.name();
    let fits = |value: &f64| format.encode(to_raw(channel, *value)).is_some();
    let cause = match channel.range {
        Some(range) if range.iter().all(fits) => return Ok(()),
        Some([lower, upper]) => format!(
            "the range {lower} to {upper} (SI) does not fit {number}: it is {} to {} raw, and {number} holds {} to {}",
            to_raw(channel, lower),
            to_raw(channel, upper),
            format.number.limits()[0],
            format.number.limits()[1],
        ),
        None => format!("an analog output of type {number} needs a range"),
    };
    let expected = "a `range` that fits the registers with this scale and offset, or a type such as i16 or f32";
    Err(channel_error(device, channel, cause, expected))
}

/// Checks that one request can hold the whole value: half of a value is invalid.
pub(super) fn check_size(
    device: &DeviceConfig,
    channel: &ChannelConfig,
    address: &Address,
    output: bool,
    requests: RequestLimits,
) -> Result<(), DriverError> {
    let (most, key) = match (address.table.is_bits(), output) {
        (true, _) => return Ok(()),
        (false, false) => (requests.read_registers, "read_registers"),
        (false, true) => (requests.write_registers, "write_registers"),
    };
    if address.width() <= most {
        return Ok(());
    }
    let cause = format!(
        "\"{address}\" has {} registers, and requests.{key} allows {most}",
        address.width()
    );
    let expected = "a smaller type, or a larger limit: a number is never read or written in parts";
    Err(channel_error(device, channel, cause, expected))
}

/// Returns true if both use the same point, or the same bit of a register.
#[must_use]
pub fn overlap(one: &Address, other: &Address) -> bool {
    let end = |address: &Address| u32::from(address.number) + u32::from(address.width());
    let apart = one.table != other.table
        || end(one) <= u32::from(other.number)
        || end(other) <= u32::from(one.number);
    let other_bit = match (one.form, other.form) {
        (Form::RegisterBit(one), Form::RegisterBit(other)) => one != other,
        _ => false,
    };
    !apart && !other_bit
}
