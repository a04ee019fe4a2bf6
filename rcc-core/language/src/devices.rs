//! The part of a cell's configuration that nets refer to: devices and channels by name, and the period. Used by the
//! loader's threads and by `rcc-cli check`.

use rcc_config::CellConfig;
use rcc_config::device::CHANNEL_KINDS;
use rcc_core::frame::DeviceModel;
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;

/// The devices of a cell; the index of a device is its index in plans.
#[derive(Clone, Debug)]
pub struct DeviceTable {
    /// Fingerprint of the configuration, stored in plans.
    pub fingerprint: u64,
    /// Period of the cycle, ns.
    pub period_ns: u64,
    /// The devices in order of their indices.
    pub devices: Vec<CellDevice>,
}

/// A device of the cell.
#[derive(Clone, Debug)]
pub struct CellDevice {
    /// Name in nets.
    pub name: String,
    /// Model for the core.
    pub model: DeviceModel,
    /// Channels by kind (in the order of [`CHANNEL_KINDS`]) and index.
    pub channels: [Vec<CellChannel>; 4],
}

/// A channel of a device.
#[derive(Clone, Debug)]
pub struct CellChannel {
    /// Name in nets.
    pub name: String,
    /// Unit of an analog channel; 1 for a digital one.
    pub unit: Unit,
    /// Smallest and largest value of an analog channel, in SI units.
    pub range: Option<[f64; 2]>,
}

impl CellDevice {
    /// Returns the channels of one kind in order of their indices.
    #[must_use]
    pub fn channels_of(&self, kind: ChannelKind) -> &[CellChannel] {
        self.channels.get(kind as usize).map_or(&[], Vec::as_slice)
    }
}

impl DeviceTable {
    /// Returns index and entry of a device.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<(usize, &CellDevice)> {
        let mut rows = self.devices.iter().enumerate();
        rows.find(|(_, device)| device.name == name)
    }

    /// Returns the device models that plans are checked against.
    #[must_use]
    pub fn models(&self) -> Vec<DeviceModel> {
        self.devices.iter().map(|device| device.model).collect()
    }

    /// Returns the number of cycles per second, Hz.
    #[must_use]
    #[allow(clippy::cast_precision_loss)] // 2^53 ns are 104 days.
    pub fn cycle_hz(&self) -> f64 {
        1e9 / self.period_ns.max(1) as f64
    }
}

impl From<&CellConfig> for DeviceTable {
    fn from(cell: &CellConfig) -> DeviceTable {
        let row = |device: &rcc_config::DeviceConfig| CellDevice {
            name: device.name.clone(),
            model: device.model(),
            channels: CHANNEL_KINDS.map(|kind| {
                let channels = device.channels_of(kind);
                let channel = |channel: &rcc_config::ChannelConfig| CellChannel {
                    name: channel.name.clone(),
                    unit: channel.unit,
                    range: channel.range,
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
