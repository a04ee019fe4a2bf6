//! The channels of a link device: the `address` of each is a topic of the other cell, or an element of an array. Read once
//! at start.

use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;
use rcc_driver_kit::driver::{DriverError, channel_error};
use rcc_driver_kit::rcc_config::device::is_output;
use rcc_driver_kit::rcc_config::{ChannelConfig, DeviceConfig};

use crate::keys::is_topic;

/// An input and its topic.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LinkChannel {
    /// Name of the channel.
    pub name: String,
    /// Digital or analog input.
    pub kind: ChannelKind,
    /// Index among the channels of its kind.
    pub index: u32,
    /// Name of the topic.
    pub topic: String,
    /// Element of an array; `None` for a topic that is one value.
    pub element: Option<usize>,
    /// Unit of the value; `None` for one without unit.
    pub unit: Option<String>,
}

const ADDRESS: &str =
    "a topic of the other cell, such as `door/open`, or an element of one, such as `arm/joints[2]`";

/// Returns the channels of a device.
pub(crate) fn link_channels(device: &DeviceConfig) -> Result<Vec<LinkChannel>, DriverError> {
    if device.channels.is_empty() {
        return Err(DriverError::Setting {
            device: device.name.clone(),
            key: "peer".to_owned(),
            cause: "the device has no channels".to_owned(),
            expected: "a channel for each topic: `door: {kind: digital input, address: door/open}`",
        });
    }
    device
        .channels
        .iter()
        .map(|channel| link_channel(device, channel))
        .collect()
}

fn link_channel(
    device: &DeviceConfig,
    channel: &ChannelConfig,
) -> Result<LinkChannel, DriverError> {
    if is_output(channel.kind) {
        let cause = "nothing is written to another cell";
        let expected = "an input; what leaves this cell is what its nets publish: `Publish`, and `link: publish`";
        return Err(channel_error(device, channel, cause, expected));
    }
    if channel.scale != 1.0 || channel.offset != 0.0 {
        let cause = "topics have SI units, so `scale` and `offset` have no meaning";
        return Err(channel_error(
            device,
            channel,
            cause,
            "a channel without both",
        ));
    }
    let wrong = || {
        channel_error(
            device,
            channel,
            format!("invalid address {}", channel.address),
            ADDRESS,
        )
    };
    let address = channel.address.as_str().ok_or_else(wrong)?;
    let (topic, element) = match address.strip_suffix(']').map(|rest| rest.rsplit_once('[')) {
        None => (address, None),
        Some(None) => return Err(wrong()),
        Some(Some((topic, number))) => (topic, Some(number.parse().map_err(|_| wrong())?)),
    };
    if !is_topic(topic) {
        return Err(wrong());
    }
    Ok(LinkChannel {
        name: channel.name.clone(),
        kind: channel.kind,
        index: channel.index,
        topic: topic.to_owned(),
        element,
        unit: (channel.unit != Unit::ONE).then(|| channel.unit.to_string()),
    })
}
