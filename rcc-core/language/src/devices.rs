//! What nets may know of a cell: devices and channels by name, and the period. A view of the configuration.
//! Used by the loader's threads and by `rcc-cli check`.

use rcc_config::CellConfig;
use rcc_config::device::CHANNEL_KINDS;
use rcc_core::frame::DeviceModel;
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;

/// The devices of a cell; the place of a device is its index in plans.
#[derive(Clone, Debug)]
pub struct DeviceTable {
    /// Fingerprint of the configuration, put into plans.
    pub fingerprint: u64,
    /// Period of the cycle, ns.
    pub period_ns: u64,
    /// The devices in order of their index.
    pub devices: Vec<Device>,
}

/// One device.
#[derive(Clone, Debug)]
pub struct Device {
    /// Name in nets.
    pub name: String,
    /// As the core knows it.
    pub model: DeviceModel,
    /// Channels by kind (in the order of [`CHANNEL_KINDS`]) and index.
    pub channels: [Vec<Channel>; 4],
}

/// One channel.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Name in nets.
    pub name: String,
    /// Unit of an analog channel.
    pub unit: Unit,
}

impl Device {
    /// The channels of one kind in order of their index.
    #[must_use]
    pub fn channels_of(&self, kind: ChannelKind) -> &[Channel] {
        self.channels.get(kind as usize).map_or(&[], Vec::as_slice)
    }
}

impl DeviceTable {
    /// Index and row of a device.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<(usize, &Device)> {
        let mut rows = self.devices.iter().enumerate();
        rows.find(|(_, device)| device.name == name)
    }

    /// The devices as plans are checked against.
    #[must_use]
    pub fn models(&self) -> Vec<DeviceModel> {
        self.devices.iter().map(|device| device.model).collect()
    }

    /// Cycles per second.
    #[must_use]
    #[allow(clippy::cast_precision_loss)] // 2^53 ns are 104 days.
    pub fn cycle_hz(&self) -> f64 {
        1e9 / self.period_ns.max(1) as f64
    }
}

impl From<&CellConfig> for DeviceTable {
    fn from(cell: &CellConfig) -> DeviceTable {
        let row = |device: &rcc_config::DeviceConfig| Device {
            name: device.name.clone(),
            model: device.model(),
            channels: CHANNEL_KINDS.map(|kind| {
                let channels = device.channels_of(kind);
                let channel = |channel: &rcc_config::ChannelConfig| Channel {
                    name: channel.name.clone(),
                    unit: channel.unit,
                };
                channels.map(channel).collect()
            }),
        };
        DeviceTable {
            fingerprint: cell.fingerprint(),
            period_ns: cell.period_ns,
            devices: cell.devices.iter().map(row).collect(),
        }
    }
}
