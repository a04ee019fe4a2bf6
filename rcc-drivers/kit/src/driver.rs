//! The interface of a driver: it speaks one device's wire protocol; boards, nets and stops are the host's task.
//! Run by the host's thread; only [`Driver::receive`] may block.

use std::sync::Arc;

use rcc_config::{ChannelConfig, DeviceConfig, DriverConfig};
use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind;
use thiserror::Error;

use crate::host::reason::Reason;

mod period;
mod settings;

pub use period::PeriodTimer;
pub use settings::Settings;

/// Measured values of one exchange, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// Joint positions, rad (linear axes: m).
    pub position: Joints,
    /// Joint torques, N·m; NaN = unknown.
    pub torque: Joints,
    /// External joint torques: measured torques minus those of the device's model, N·m; NaN = unknown.
    pub external_torque: Joints,
    /// External force and torque at the flange `[fx fy fz tx ty tz]`, N and N·m, sensor frame of the device; NaN =
    /// unknown.
    pub wrench: [f64; 6],
    /// Bit i: digital input i.
    pub digital: u64,
    /// Bit i: digital input i is known.
    pub digital_known: u64,
    /// Analog inputs; NaN = unknown.
    pub analog: [f64; ANALOG_MAX],
}

impl Inputs {
    /// No input is known; positions and torques are 0.
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

/// Values sent to the device in one exchange, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// Joint set-points, rad (linear axes: m); effective while the device is commandable.
    pub position: Joints,
    /// Stiffness and damping set-points for the control mode that the device runs, see [`Exchange::strategy`].
    pub impedance: Impedance,
    /// Bit i: value of digital output i.
    pub digital: u64,
    /// Bit i: digital output i has a value; otherwise the device keeps its present value, or gets 0 if the wire needs a
    /// value.
    pub digital_set: u64,
    /// Analog outputs, within their configured ranges; NaN = no value, as for `digital_set`.
    pub analog: [f64; ANALOG_MAX],
    /// Bit i: a net commands digital output i, in this cycle or in one since the last exchange; the value of any other is that
    /// of its `on_release`.
    pub digital_commanded: u64,
    /// Bit i: the same for analog output i.
    pub analog_commanded: u64,
}

impl Outputs {
    /// No output has a value.
    pub const NONE: Outputs = Outputs {
        position: [0.0; JOINTS_MAX],
        impedance: Impedance::NONE,
        digital: 0,
        digital_set: 0,
        analog: [f64::NAN; ANALOG_MAX],
        digital_commanded: 0,
        analog_commanded: 0,
    };
}

/// Status of one exchange with the device, without the measured values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exchange {
    /// The device follows [`Outputs::position`]; otherwise it holds itself at `mirror`. Always true for plain I/O.
    pub commandable: bool,
    /// A net may start commanding the device; otherwise `reason` says why not. A running net continues as long as the
    /// device is `commandable`.
    pub startable: bool,
    /// Control mode that the device runs; a net that commands another one is not started.
    pub strategy: ControlMode,
    /// Position at which the device holds itself while it is not commandable, rad (linear axes: m).
    pub mirror: Joints,
    /// Periods of the device since the last exchange, at least 1.
    pub ticks: u64,
    /// Period of the device, ns; greater than 0.
    pub period_ns: u64,
    /// Connection quality, thousandths; 1000 is best.
    pub quality_permille: u32,
    /// One of the driver's reason numbers; 0 = none.
    pub reason: u32,
    /// Number of answers that reached the device late or not at all, since the driver started.
    pub late: u64,
    /// Number of datagrams refused since the driver started.
    pub refused: u64,
}

impl Exchange {
    /// Returns the device's period, s; greater than 0.
    pub(crate) fn period_s(&self) -> f64 {
        self.period_ns.max(1) as f64 * 1e-9
    }

    /// Returns the time since the last exchange, s; greater than 0.
    pub(crate) fn dt_s(&self) -> f64 {
        self.ticks.max(1) as f64 * self.period_s()
    }
}

/// Why there was no exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LinkError {
    /// Nothing was received within the time-out; this may be only a pause.
    #[error("the device is silent")]
    Silent,
    /// The connection is broken; the next [`Driver::receive`] tries to restore it.
    #[error("the device cannot be reached (reason {reason})")]
    Lost {
        /// One of the driver's reason numbers.
        reason: u32,
    },
}

/// Why a driver cannot work with its configuration.
#[derive(Debug, Error)]
pub enum DriverError {
    /// No driver of this program has this name.
    #[error("devices.{device}.driver: unknown driver `{driver}`; available drivers: {known}")]
    UnknownDriver {
        /// Name of the device.
        device: String,
        /// The name that the configuration gives.
        driver: String,
        /// Names of all drivers, separated by commas.
        known: String,
    },
    /// A setting is missing or invalid.
    #[error("devices.{device}.settings.{key}: {cause}; expected {expected}")]
    Setting {
        /// Name of the device.
        device: String,
        /// Key of the setting.
        key: String,
        /// Cause.
        cause: String,
        /// Valid values, with an example.
        expected: &'static str,
    },
    /// The driver has no such setting.
    #[error("devices.{device}.settings.{key}: unknown setting; available settings: {known}")]
    UnknownSetting {
        /// Name of the device.
        device: String,
        /// Key of the setting.
        key: String,
        /// Keys of all settings, separated by commas.
        known: String,
    },
    /// The driver cannot reach this channel.
    #[error("devices.{device}.channels.{channel}: {cause}; expected {expected}")]
    Channel {
        /// Name of the device.
        device: String,
        /// Name of the channel.
        channel: String,
        /// Cause.
        cause: String,
        /// Valid values, with an example.
        expected: &'static str,
    },
    /// The robot is missing, or the driver cannot move it.
    #[error("devices.{device}.robot: {cause}")]
    Robot {
        /// Name of the device.
        device: String,
        /// Cause and remedy.
        cause: &'static str,
    },
    /// The operating system refuses what a setting asks for.
    #[error(
        "devices.{device}.settings.{key}: {value}: {source}; check that no other driver is running and that the address belongs to this machine"
    )]
    System {
        /// Name of the device.
        device: String,
        /// Key of the setting.
        key: &'static str,
        /// Value of the setting.
        value: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

/// One driver: one device cycle is a [`Driver::receive`] followed by a [`Driver::send`].
///
/// [`crate::host::Host`] owns it and calls all methods from one thread, which may run with SCHED_FIFO: first `open`,
/// then `receive` repeatedly; `send` follows each `receive` that returned an exchange, and only those; `release` is
/// called once, near the end. Only `receive` may block. A driver must not panic, whatever arrives: bytes from a device
/// are untrusted. A driver keeps no set-point, moves nothing on its own, and never decides the value of an output that
/// is not commanded: all that is the host's task. `docs/drivers.md` explains how to write one.
pub trait Driver: Send {
    /// Checks and prepares everything that does not need the device: settings, channels, robot, sockets. Called once,
    /// before the host joins its cell; does not block.
    ///
    /// # Errors
    /// Returns what is wrong in the configuration, with the path of the key and the expected value. A device that does
    /// not answer is not an error: it may appear later.
    fn open(device: &DeviceConfig) -> Result<Self, DriverError>
    where
        Self: Sized;

    /// Waits for the device's next cycle, at most `timeout`, and stores the measured values in `inputs`, in SI units. A
    /// driver that keeps its own period may exceed `timeout` by the duration of one transaction.
    ///
    /// If the device sends by itself, it is the clock; otherwise the driver keeps a period. `timeout` is at most 10 ms:
    /// between two calls the host looks at the executor's board and at the stop request. After a stall only the newest
    /// cycle counts; [`Exchange::ticks`] gives the number of cycles.
    ///
    /// # Errors
    /// Returns an error if there was no exchange; `inputs` are then unchanged. [`LinkError::Silent`]: the host declares
    /// the device lost after `command_timeout` or five of its periods, whichever is longer. [`LinkError::Lost`]: at
    /// once. An arm in motion that answers again within that time is brought to rest within its limits. In both cases
    /// the host calls again, and the driver tries to reach the device again by itself, with growing pauses if an attempt
    /// is expensive.
    fn receive(
        &mut self,
        timeout: std::time::Duration,
        inputs: &mut Inputs,
    ) -> Result<Exchange, LinkError>;

    /// Answers the exchange that [`Driver::receive`] returned, without blocking longer than the wire needs. `outputs`
    /// are within the configured limits and ranges, in SI units; an output without a value keeps its value on the
    /// device. The values are sent again in every cycle, so the next cycle repairs a loss.
    ///
    /// # Errors
    /// Returns an error if the answer could not be sent.
    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError>;

    /// Asks the device to leave command mode; the arm is at rest by then. Exchanges continue for at most one second,
    /// until one is not commandable. Does nothing for plain I/O.
    fn release(&mut self);

    /// Returns the meaning of the reason numbers if it depends on the configuration; otherwise the driver's entry in
    /// [`DriverEntry`] applies. Called once, at the start.
    fn reasons(&self) -> Option<&'static [Reason]> {
        None
    }

    /// Returns the driver's connection counters for `rcc-cli doctor device`; `None` by default. Called once, at the
    /// start.
    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        None
    }
}

/// A driver as a program offers it.
#[derive(Debug)]
pub struct DriverEntry {
    /// Name in a cell's configuration.
    pub name: &'static str,
    /// Opens the driver, see [`Driver::open`].
    pub open: fn(&DeviceConfig) -> Result<Box<dyn Driver>, DriverError>,
    /// Meaning of the driver's reason numbers, which start at 100.
    pub reasons: &'static [Reason],
}

impl DriverEntry {
    /// Returns the entry of a driver.
    #[must_use]
    pub const fn new<D: Driver + 'static>(
        name: &'static str,
        reasons: &'static [Reason],
    ) -> DriverEntry {
        DriverEntry {
            name,
            open: boxed::<D>,
            reasons,
        }
    }

    /// Returns the driver with the configured name; or, if the configuration names a program, the only driver of that
    /// program.
    ///
    /// # Errors
    /// Returns [`DriverError::UnknownDriver`] if none of these drivers is meant.
    pub fn find<'a>(
        drivers: &'a [DriverEntry],
        device: &DeviceConfig,
    ) -> Result<&'a DriverEntry, DriverError> {
        let found = match (&device.driver, drivers) {
            (DriverConfig::Program(_), [only]) => Some(only),
            (DriverConfig::Program(_), _) => None,
            (DriverConfig::Name(name), _) => drivers.iter().find(|entry| entry.name == name),
        };
        found.ok_or_else(|| {
            let names: Vec<&str> = drivers.iter().map(|entry| entry.name).collect();
            DriverError::UnknownDriver {
                device: device.name.clone(),
                driver: device.driver.to_string(),
                known: names.join(", "),
            }
        })
    }
}

fn boxed<D: Driver + 'static>(device: &DeviceConfig) -> Result<Box<dyn Driver>, DriverError> {
    D::open(device).map(|driver| Box::new(driver) as Box<dyn Driver>)
}

/// Counters of a driver's connection. They are atomics: any thread may read them at any time without blocking.
pub trait LinkDiagnosis: Send + Sync + std::fmt::Debug {
    /// Returns the present state of the connection as a JSON object. Called about once per second by a thread other
    /// than the exchange thread; may allocate.
    fn link(&self) -> serde_json::Value;
}

/// Converts a raw value of the wire to SI units; NaN if it is not finite, or outside of the channel's range.
#[must_use]
pub fn to_si(channel: &ChannelConfig, raw: f64) -> f64 {
    let value = raw * channel.scale + channel.offset;
    let is_inside = |[lower, upper]: [f64; 2]| lower <= value && value <= upper;
    match value.is_finite() && channel.range.is_none_or(is_inside) {
        true => value,
        false => f64::NAN,
    }
}

/// Converts an SI value to the raw value of the wire, without rounding.
#[must_use]
pub fn to_raw(channel: &ChannelConfig, value: f64) -> f64 {
    (value - channel.offset) / channel.scale
}

/// Returns an error in the configuration of one channel.
pub fn channel_error(
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

/// Returns the channels of one kind, in the order of their index.
pub fn channels(device: &DeviceConfig, kind: ChannelKind) -> Vec<&ChannelConfig> {
    device.channels_of(kind).collect()
}
