//! A device of a cell: its driver, its robot and its named channels.
//! Read once at start-up by every process that works with the cell; never by the real-time thread.

use rcc_core::frame::DeviceModel;
use rcc_core::pose::Pose;
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;
use rcc_core::workspace::Workspace;

use crate::robot::{NO_JOINTS, RobotConfig};

mod read;

pub(crate) use read::channels;

/// One device and how its driver reaches it.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceConfig {
    /// Name, unique in its cell; `[a-z][a-z0-9_-]{0,31}`.
    pub name: String,
    /// Name of the driver; only the drivers know which there are.
    pub driver: String,
    /// The arm, `None` for plain I/O.
    pub robot: Option<RobotConfig>,
    /// What only this driver understands, an object; `${port}` is already replaced in its texts.
    pub settings: serde_json::Value,
    /// Channels of all kinds, in the order of the file.
    pub channels: Vec<ChannelConfig>,
    /// How far the first set-point of a net may be from the hold set-point, rad per joint.
    pub first_tolerance_rad: f64,
    /// Where its base stands in the world of the cell.
    pub base: Pose,
    /// Where the arm may be; `None` = anywhere.
    pub workspace: Option<Workspace>,
    /// A command image older than this is stale, and the driver brings its device to rest; ns.
    pub command_timeout_ns: u64,
    /// How long set-points wait in the driver before they are played, ns; at most 12 periods.
    pub delay_ns: u64,
}

/// One named input or output.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelConfig {
    /// Name, unique in its device; `[a-z][a-z0-9_]{0,31}`.
    pub name: String,
    /// Digital or analog, input or output.
    pub kind: ChannelKind,
    /// Place among the channels of the same kind of its device, in the order of the file, from 0.
    pub index: u32,
    /// Where it is in the device, a whole number or a text; only the driver understands it.
    pub address: serde_json::Value,
    /// Unit of its value; [`Unit::ONE`] for a digital channel.
    pub unit: Unit,
    /// SI value = raw × `scale` + `offset`; never 0. 1 for a digital channel.
    pub scale: f64,
    /// SI value at raw 0.
    pub offset: f64,
    /// Smallest and largest value in SI units; a value outside is refused, never clamped.
    pub range: Option<[f64; 2]>,
    /// What the driver does when nobody commands it any more: given for every output, for no input.
    pub on_release: Option<OnRelease>,
}

/// What an output does on termination, null and loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OnRelease {
    /// It keeps its last value.
    Hold,
    /// It goes to this value, SI; 0 or 1 for a digital output.
    Safe(f64),
}

/// All kinds, in the order in which [`DeviceModel::channels`] counts them.
pub const CHANNEL_KINDS: [ChannelKind; 4] = [
    ChannelKind::DigitalInput,
    ChannelKind::DigitalOutput,
    ChannelKind::AnalogInput,
    ChannelKind::AnalogOutput,
];

/// A kind as it is written in the file.
#[must_use]
pub fn kind_name(kind: ChannelKind) -> &'static str {
    match kind {
        ChannelKind::DigitalInput => "digital input",
        ChannelKind::DigitalOutput => "digital output",
        ChannelKind::AnalogInput => "analog input",
        ChannelKind::AnalogOutput => "analog output",
    }
}

/// True if the device is told its value.
#[must_use]
pub fn is_output(kind: ChannelKind) -> bool {
    matches!(kind, ChannelKind::DigitalOutput | ChannelKind::AnalogOutput)
}

/// True if its value is a Bool.
#[must_use]
pub fn is_digital(kind: ChannelKind) -> bool {
    matches!(kind, ChannelKind::DigitalInput | ChannelKind::DigitalOutput)
}

impl DeviceConfig {
    /// The device as the core knows it.
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
            // At most DIGITAL_MAX = 64 of a kind.
            channels: CHANNEL_KINDS.map(|kind| self.channels_of(kind).count() as u32),
            impedance: self.robot.as_ref().and_then(|robot| robot.impedance),
        }
    }

    /// The channel of this kind and name.
    #[must_use]
    pub fn channel(&self, kind: ChannelKind, name: &str) -> Option<&ChannelConfig> {
        self.channels_of(kind).find(|channel| channel.name == name)
    }

    /// The channels of one kind, in order of their index.
    pub fn channels_of(&self, kind: ChannelKind) -> impl Iterator<Item = &ChannelConfig> {
        self.channels
            .iter()
            .filter(move |channel| channel.kind == kind)
    }
}
