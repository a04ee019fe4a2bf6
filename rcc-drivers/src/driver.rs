//! What a driver is: it speaks one device's wire, and nothing else; everything about boards, nets and rest is the host's.
//! Run by the one thread of the host; only [`Driver::receive`] may wait.

use std::sync::Arc;

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind;
use thiserror::Error;

mod settings;

pub use settings::Settings;

/// What a device measured in one exchange; SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// Joint positions, rad.
    pub position: Joints,
    /// Joint torques, N·m.
    pub torque: Joints,
    /// Joint torques that the device's model does not explain, N·m.
    pub external_torque: Joints,
    /// External force and torque at the flange `[fx fy fz tx ty tz]`, N and N·m, sensor frame of the device.
    pub wrench: [f64; 6],
    /// Bit i: digital input i.
    pub digital: u64,
    /// Bit i: digital input i is known.
    pub digital_known: u64,
    /// Analog inputs; NaN is unknown.
    pub analog: [f64; ANALOG_MAX],
}

impl Inputs {
    /// Nothing is known; positions and torques are 0.
    pub const NONE: Inputs = Inputs {
        position: [0.0; JOINTS_MAX],
        torque: [0.0; JOINTS_MAX],
        external_torque: [0.0; JOINTS_MAX],
        wrench: [0.0; 6],
        digital: 0,
        digital_known: 0,
        analog: [f64::NAN; ANALOG_MAX],
    };
}

/// What a device is told in one exchange; SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// Joint set-points, rad; they count while the device is commandable.
    pub position: Joints,
    /// For the strategy that the device runs, see [`Exchange::strategy`]: how softly the joints are held.
    pub impedance: Impedance,
    /// Bit i: value of digital output i.
    pub digital: u64,
    /// Bit i: digital output i has a value; without one the device keeps what it has, or 0 if the wire needs a number.
    pub digital_set: u64,
    /// Analog outputs, inside of their configured ranges; NaN = no value, as above.
    pub analog: [f64; ANALOG_MAX],
}

impl Outputs {
    /// Says nothing.
    pub const NONE: Outputs = Outputs {
        position: [0.0; JOINTS_MAX],
        impedance: Impedance::NONE,
        digital: 0,
        digital_set: 0,
        analog: [f64::NAN; ANALOG_MAX],
    };
}

/// How one exchange with the device went, besides what it measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exchange {
    /// The device follows [`Outputs::position`]; otherwise it is held by itself at `mirror`. True for plain I/O.
    pub commandable: bool,
    /// A net may begin to command it; otherwise `reason` says why not. What runs already goes on while commandable.
    pub startable: bool,
    /// What the device makes of set-points; a net for another strategy does not begin.
    pub strategy: ControlMode,
    /// Where the device holds itself while it is not commandable, rad.
    pub mirror: Joints,
    /// Periods of the device since the last exchange, at least 1.
    pub ticks: u64,
    /// Period of the device, ns; greater than 0.
    pub period_ns: u64,
    /// Quality of the connection in thousandths, 1000 is best.
    pub quality_permille: u32,
    /// One of the driver's reasons, 0 = fine.
    pub reason: u32,
    /// Answers that the device did not get in time, since the driver started.
    pub late: u64,
    /// Datagrams refused, since the driver started.
    pub refused: u64,
}

/// Why there was no exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LinkError {
    /// Nothing came within the time-out; that may be a pause.
    #[error("the device is silent")]
    Silent,
    /// The connection is broken; the driver tries again at the next [`Driver::receive`].
    #[error("the device is not reached (reason {reason})")]
    Lost {
        /// One of the driver's reasons.
        reason: u32,
    },
}

/// Why a driver cannot work with its configuration.
#[derive(Debug, Error)]
pub enum DriverError {
    /// There is no driver of this name.
    #[error("devices.{device}.driver: there is no driver '{driver}'; there are: {known}")]
    UnknownDriver {
        /// The device.
        device: String,
        /// What was asked for.
        driver: String,
        /// All drivers.
        known: String,
    },
    /// A setting is missing or has a value of another form.
    #[error("devices.{device}.settings.{key}: {cause}; give {expected}")]
    Setting {
        /// The device.
        device: String,
        /// The setting.
        key: String,
        /// What is wrong.
        cause: String,
        /// What it should be.
        expected: &'static str,
    },
    /// A setting that the driver does not have.
    #[error("devices.{device}.settings.{key}: the driver has no such setting; it has: {known}")]
    UnknownSetting {
        /// The device.
        device: String,
        /// The setting.
        key: String,
        /// All settings.
        known: String,
    },
    /// A channel that the driver cannot reach.
    #[error("devices.{device}.channels.{channel}: {cause}; give {expected}")]
    Channel {
        /// The device.
        device: String,
        /// The channel.
        channel: String,
        /// What is wrong.
        cause: String,
        /// What it should be.
        expected: &'static str,
    },
    /// The robot is missing, or is another one than the driver can move.
    #[error("devices.{device}.robot: {cause}")]
    Robot {
        /// The device.
        device: String,
        /// What is wrong, and what to do.
        cause: &'static str,
    },
    /// The system refuses what the settings ask for.
    #[error(
        "devices.{device}.settings.{key}: {value}: {source}; is another driver running, or the address of another machine?"
    )]
    System {
        /// The device.
        device: String,
        /// The setting.
        key: &'static str,
        /// Its value.
        value: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// One driver: one device cycle is a [`Driver::receive`] followed by a [`Driver::send`].
///
/// [`crate::host::Host`] owns it and calls everything from one thread, which may run with SCHED_FIFO: the first is
/// `open`, then `receive` again and again; `send` follows each `receive` that brought an exchange, and nothing else;
/// `release` comes once, near the end. Only `receive` may wait. Nothing panics, whatever the wire says: bytes of a device
/// are hostile. A driver keeps no set-point of its own, moves nothing by itself, and never decides what an output is when
/// nobody commands it: all that is the host's. `docs/drivers.md` is the way to one.
pub trait Driver: Send {
    /// Prepares everything that can be checked without the device: settings, channels, robot, sockets. Called once,
    /// before the host joins its cell; it waits for nothing.
    ///
    /// # Errors
    /// What is wrong in the configuration, with the path of the key and what to give. A device that does not answer is no
    /// error: it may come later.
    fn open(device: &DeviceConfig) -> Result<Self, DriverError>
    where
        Self: Sized;

    /// Waits for the device's next cycle, at most `timeout` (a driver that keeps its own period may end later by what a
    /// single transaction takes), and fills `inputs` with what it measured, in SI units.
    ///
    /// A device that sends by itself is the clock; otherwise the driver keeps a period. `timeout` is at most 10 ms: in
    /// between, the host looks at the executor's board and at whether it is to end. After a stall only the newest cycle
    /// counts; [`Exchange::ticks`] says how many there were.
    ///
    /// # Errors
    /// There was no exchange; `inputs` are as before. [`LinkError::Silent`] is a pause, after a while of which the host
    /// takes the device for lost; [`LinkError::Lost`] is known at once. Either way the host calls again, and the driver
    /// tries to reach the device again by itself, with a pause that grows where an attempt costs something.
    fn receive(
        &mut self,
        timeout: std::time::Duration,
        inputs: &mut Inputs,
    ) -> Result<Exchange, LinkError>;

    /// Answers the exchange that [`Driver::receive`] has begun, without waiting longer than the wire needs. `outputs` are
    /// within the configured limits and ranges, in SI units; what is not set is left as the device has it. The same
    /// values come again in every cycle: what was lost heals with the next one.
    ///
    /// # Errors
    /// The answer did not leave.
    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError>;

    /// Asks the device to leave command mode: the arm rests by now. Further exchanges follow for at most a second, until
    /// one is not commandable. Plain I/O does nothing.
    fn release(&mut self);

    /// What its reason numbers mean, if its configuration decides that; otherwise they are those of its row in
    /// [`crate::drivers::DRIVERS`]. Asked for once, at the start.
    fn reasons(&self) -> Option<&'static [crate::host::reason::Reason]> {
        None
    }

    /// What it counts about its connection, for `rcc-cli doctor device`; none by default. Asked for once, at the start.
    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        None
    }
}

/// Figures that a driver counts while it exchanges, as atomics: any thread may look at any time, and nobody waits.
pub trait LinkDiagnosis: Send + Sync + std::fmt::Debug {
    /// Everything that is known about the connection now, as a JSON object. Called about once a second by a thread that
    /// is not the exchange's; it may allocate.
    fn link(&self) -> serde_json::Value;
}

/// Raw value of the wire → SI.
#[must_use]
pub fn to_si(channel: &ChannelConfig, raw: f64) -> f64 {
    raw * channel.scale + channel.offset
}

/// SI → raw value of the wire, not rounded.
#[must_use]
pub fn to_raw(channel: &ChannelConfig, value: f64) -> f64 {
    (value - channel.offset) / channel.scale
}

/// A fault of one channel's configuration.
pub(crate) fn channel_error(
    device: &DeviceConfig,
    channel: &ChannelConfig,
    cause: impl Into<String>,
    expected: &'static str,
) -> DriverError {
    DriverError::Channel {
        device: device.name.clone(),
        channel: channel.name.clone(),
        cause: cause.into(),
        expected,
    }
}

/// The channels of a kind, in order of their index.
pub(crate) fn channels(device: &DeviceConfig, kind: ChannelKind) -> Vec<&ChannelConfig> {
    device.channels_of(kind).collect()
}
