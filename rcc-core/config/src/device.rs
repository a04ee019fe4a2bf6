//! A device of a cell: its driver, its robot and its named channels.
//! Read once at start-up by every process that works with the cell; never by the real-time thread.

use std::path::PathBuf;

use rcc_core::frame::DeviceModel;
use rcc_core::pose::Pose;
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;
use rcc_core::workspace::Workspace;

use crate::driver::DriverConfig;
use crate::robot::{NO_JOINTS, RobotConfig};

mod read;

#[cfg(test)]
pub(crate) use read::KEYS as CHANNEL_KEYS;
pub(crate) use read::channels;

/// Configuration of one device.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceConfig {
    /// Name, unique in its cell; `[a-z][a-z0-9_-]{0,31}`.
    pub name: String,
    /// Which program drives it.
    pub driver: DriverConfig,
    /// Folder of the cell's file, to which the paths of programs are relative.
    pub folder: PathBuf,
    /// The arm; `None` for plain I/O.
    pub robot: Option<RobotConfig>,
    /// Driver-specific settings, an object; `${port}` is already replaced in its texts.
    pub settings: serde_json::Value,
    /// Channels of all kinds, in the order of the file.
    pub channels: Vec<ChannelConfig>,
    /// Maximum distance of a net's first set-point from the hold set-point, rad per joint.
    pub first_tolerance_rad: f64,
    /// Pose of its base in the world frame of the cell.
    pub base: Pose,
    /// Region that the arm must not leave; `None`: no restriction.
    pub workspace: Option<Workspace>,
    /// Age beyond which a command image is stale and the driver brings its device to rest, ns.
    pub command_timeout_ns: u64,
    /// Time that set-points wait in the driver before they are played, ns; at most 252 periods.
    pub delay_ns: u64,
}

/// One named input or output.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelConfig {
    /// Name, unique in its device; `[a-z][a-z0-9_]{0,31}`.
    pub name: String,
    /// Digital or analog, input or output.
    pub kind: ChannelKind,
    /// Index among the channels of the same kind of its device, in the order of the file, from 0.
    pub index: u32,
    /// Driver-specific address in the device, an integer or a text.
    pub address: serde_json::Value,
    /// Unit of its value; [`Unit::ONE`] for a digital channel.
    pub unit: Unit,
    /// SI value = raw × `scale` + `offset`; never 0. 1 for a digital channel.
    pub scale: f64,
    /// SI value for raw value 0.
    pub offset: f64,
    /// Smallest and largest value in SI units; a value outside is refused, never clamped.
    pub range: Option<[f64; 2]>,
    /// Action of the driver when the output is no longer commanded: present for every output, absent for inputs.
    pub on_release: Option<OnRelease>,
}

/// Action of an output on termination, null and loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OnRelease {
    /// Keeps its last value.
    Hold,
    /// Changes to this value, SI; 0 or 1 for a digital output.
    Safe(f64),
}

/// All kinds of channels, in the order of [`DeviceModel::channels`].
pub const CHANNEL_KINDS: [ChannelKind; 4] = [
    ChannelKind::DigitalInput,
    ChannelKind::DigitalOutput,
    ChannelKind::AnalogInput,
    ChannelKind::AnalogOutput,
];

/// Returns the name of a kind as written in the file.
#[must_use]
pub fn kind_name(kind: ChannelKind) -> &'static str {
    match kind {
        ChannelKind::DigitalInput => "digital input",
        ChannelKind::DigitalOutput => "digital output",
        ChannelKind::AnalogInput => "analog input",
        ChannelKind::AnalogOutput => "analog output",
    }
}

/// Returns true if values are sent to the device.
#[must_use]
pub fn is_output(kind: ChannelKind) -> bool {
    matches!(kind, ChannelKind::DigitalOutput | ChannelKind::AnalogOutput)
}

/// Returns true if the value is a Bool.
#[must_use]
pub fn is_digital(kind: ChannelKind) -> bool {
    matches!(kind, ChannelKind::DigitalInput | ChannelKind::DigitalOutput)
}

impl DeviceConfig {
    /// Returns the device model of the core.
    #[must_use]
    pub fn model(&self) -> DeviceModel {
        let limits = self.robot.as_ref().map_or(NO_JOINTS, RobotConfig::limits);
        DeviceModel {
            // At most JOINTS_MAX = 8.
            joints: limits.joints as u32,
            arm: self.robot.as_ref().map(|robot| robot.arm),
            limits,
            first_tolerance_rad: self.first_tolerance_rad,
            base: self.base,
            workspace: self.workspace,
            // At most DIGITAL_MAX = 64 per kind.
            channels: CHANNEL_KINDS.map(|kind| self.channels_of(kind).count() as u32),
            impedance: self.robot.as_ref().and_then(|robot| robot.impedance),
        }
    }

    /// Returns the channel with this kind and name.
    #[must_use]
    pub fn channel(&self, kind: ChannelKind, name: &str) -> Option<&ChannelConfig> {
        self.channels_of(kind).find(|channel| channel.name == name)
    }

    /// Returns the channels of one kind, in the order of their indices.
    pub fn channels_of(&self, kind: ChannelKind) -> impl Iterator<Item = &ChannelConfig> {
        self.channels
            .iter()
            .filter(move |channel| channel.kind == kind)
    }
}
