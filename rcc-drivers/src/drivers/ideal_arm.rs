//! The driver `ideal-arm`: a simulated arm inside the driver, whose position is the set-point of the previous period.
//! Run by the host's thread, which waits in [`Driver::receive`] for the next period.
//!
//! Any robot of `configs/robots` works: nets, several arms and applications can be tried in a real cell, with boards,
//! guard, start conditions and stops, without hardware or a simulator of its wire. Outputs are looped back to the
//! inputs of the same address. The arm has neither mass nor contact: torques and forces are 0.

use std::time::Duration;

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::impedance::ControlMode;
use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX, JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind;

use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkError, Outputs, PeriodTimer, Settings,
    channel_error, channels, to_raw, to_si,
};
use rcc_driver_kit::host::reason::Reason;

/// The driver is ending.
pub const RELEASED: u32 = 100;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[(
    RELEASED,
    "the driver has released the arm and is ending: start it again",
)];

/// The driver and the state of its arm.
#[derive(Debug)]
pub struct IdealArm {
    timer: PeriodTimer,
    position: Joints,
    /// By kind: digital in, digital out, analog in, analog out; in order of their index.
    points: [Vec<IdealChannel>; 4],
    digital: [bool; DIGITAL_MAX + 1],
    /// Raw values; NaN = never written.
    analog: [f64; ANALOG_MAX + 1],
    released: bool,
    /// The joints are linear axes: their torques are unknown.
    linear: bool,
}

/// A channel and its address.
#[derive(Clone, Debug)]
struct IdealChannel {
    address: usize,
    config: ChannelConfig,
}

impl Driver for IdealArm {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let Some(robot) = &device.robot else {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "ideal-arm needs a robot: write for example `robot: ../robots/lwr4plus.yaml`",
            });
        };
        let mut settings = Settings::of(device);
        let period = settings.duration("period", Duration::from_millis(1))?;
        let position = settings.read(
            "start",
            "a joint position inside of its range for each joint of the robot, such as [0, \"-30 deg\", 0.5] (rad, or m for linear axes, or with a unit)",
            Some(robot.nearest_to_zero()),
            |value| robot.positions(value),
        )?;
        settings.finish()?;
        Ok(Self {
            timer: PeriodTimer::new(period),
            position,
            points: [
                points(device, ChannelKind::DigitalInput)?,
                points(device, ChannelKind::DigitalOutput)?,
                points(device, ChannelKind::AnalogInput)?,
                points(device, ChannelKind::AnalogOutput)?,
            ],
            digital: [false; DIGITAL_MAX + 1],
            analog: [f64::NAN; ANALOG_MAX + 1],
            released: false,
            linear: robot.arm.is_linear(),
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let ticks = self.timer.wait(timeout)?;
        *inputs = self.inputs();
        Ok(Exchange {
            strategy: ControlMode::Position,
            commandable: !self.released,
            startable: !self.released,
            mirror: self.position,
            ticks,
            period_ns: self.timer.period_ns(),
            quality_permille: 1000,
            reason: if self.released { RELEASED } else { 0 },
            late: 0,
            refused: 0,
        })
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        if !self.released {
            self.position = outputs.position;
        }
        let [_, digital, _, analog] = &self.points;
        for (point, bit) in digital.iter().zip(0..) {
            if outputs.digital_set >> bit & 1 == 1
                && let Some(place) = self.digital.get_mut(point.address)
            {
                *place = outputs.digital >> bit & 1 == 1;
            }
        }
        for (point, value) in analog.iter().zip(outputs.analog) {
            if value.is_finite()
                && let Some(place) = self.analog.get_mut(point.address)
            {
                *place = to_raw(&point.config, value);
            }
        }
        Ok(())
    }

    fn release(&mut self) {
        self.released = true;
    }
}

impl IdealArm {
    fn inputs(&self) -> Inputs {
        let mut inputs = Inputs {
            position: self.position,
            ..Inputs::NONE
        };
        if self.linear {
            inputs.torque = [f64::NAN; JOINTS_MAX];
            inputs.external_torque = [f64::NAN; JOINTS_MAX];
        }
        let [digital, _, analog, _] = &self.points;
        for (point, bit) in digital.iter().zip(0..) {
            let on = self.digital.get(point.address).is_some_and(|on| *on);
            inputs.digital |= u64::from(on) << bit;
            inputs.digital_known |= 1 << bit;
        }
        for (point, place) in analog.iter().zip(&mut inputs.analog) {
            let raw = self.analog.get(point.address).copied();
            *place = to_si(&point.config, raw.unwrap_or(f64::NAN));
        }
        inputs
    }
}

fn points(device: &DeviceConfig, kind: ChannelKind) -> Result<Vec<IdealChannel>, DriverError> {
    let (most, expected) = match kind {
        ChannelKind::DigitalInput | ChannelKind::DigitalOutput => {
            (DIGITAL_MAX, "a number from 1 to 64; each output its own")
        }
        ChannelKind::AnalogInput | ChannelKind::AnalogOutput => {
            (ANALOG_MAX, "a number from 1 to 16; each output its own")
        }
    };
    let is_output = matches!(kind, ChannelKind::DigitalOutput | ChannelKind::AnalogOutput);
    let mut found: Vec<IdealChannel> = Vec::new();
    for channel in channels(device, kind) {
        let address = channel.address.as_u64();
        let address = address.and_then(|address| usize::try_from(address).ok());
        let address = address.filter(|address| (1..=most).contains(address));
        let address = address.ok_or_else(|| {
            let cause = format!("the arm has no channel {}", channel.address);
            channel_error(device, channel, cause, expected)
        })?;
        let other = found.iter().find(|other| other.address == address);
        if let Some(other) = other.filter(|_| is_output) {
            let cause = format!(
                "number {address} is already used by '{}'",
                other.config.name
            );
            return Err(channel_error(device, channel, cause, expected));
        }
        found.push(IdealChannel {
            address,
            config: channel.clone(),
        });
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
