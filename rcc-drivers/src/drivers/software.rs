//! The driver `software`: a device that is a program in any language, such as a camera or a learned policy.
//! Run by the host's thread, which waits in [`Driver::receive`] for the next period only; the program is reached by
//! [`process`], whose threads it never waits for.
//!
//! The program reads lines of JSON and answers each with one: `docs/software-devices.md` has the protocol.

use std::time::Duration;

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::impedance::ControlMode;
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX};
use rcc_core::primitive::ChannelKind;
use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs, PeriodTimer,
    Settings, channel_error, channels, to_raw, to_si,
};
use rcc_driver_kit::host::reason::Reason;

mod message;
mod process;

use message::{Frame, Values};
use process::{Program, ProgramState};

/// The program is not running.
pub const ENDED: u32 = 100;
/// The program has sent nothing yet.
pub const STARTING: u32 = 101;
/// The newest values are too old.
pub const LATE: u32 = 102;
/// A value is outside of its channel's range.
pub const RANGE: u32 = 103;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        ENDED,
        "the program of settings.command has ended or cannot be started: its last words are in the log; it is started again",
    ),
    (
        STARTING,
        "the program of settings.command has not answered yet: it must answer each line that it reads with one line",
    ),
    (
        LATE,
        "the program of settings.command answers later than settings.timeout: its values are null until it does",
    ),
    (
        RANGE,
        "the program of settings.command gives a value outside of its channel's range: that value is null",
    ),
];

/// Address of the analog input that is the age of the program's values.
const AGE: &str = "age";

/// The driver of one program.
#[derive(Debug)]
pub struct Software {
    program: Program,
    timer: PeriodTimer,
    timeout: Duration,
    /// By kind: digital in, digital out, analog in, analog out; in order of their index.
    points: [Vec<ChannelConfig>; 4],
    newest: Option<Values>,
    refused: u64,
}

impl Driver for Software {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        if device.robot.is_some() {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "a software device has channels only: let a net command an arm by its values",
            });
        }
        let mut settings = Settings::of(device);
        let command = settings.read(
            "command",
            "a program and its arguments, such as [python3, camera.py]; it is started in the folder of the cell's file",
            None,
            |value| {
                let words = value.as_array()?.iter();
                let words: Option<Vec<String>> =
                    words.map(|word| word.as_str().map(str::to_owned)).collect();
                words.filter(|words| words.first().is_some_and(|first| !first.is_empty()))
            },
        )?;
        let period = settings.duration("period", Duration::from_millis(10))?;
        let timeout = settings.duration("timeout", 10 * period)?;
        settings.finish()?;
        let points = [
            points(device, ChannelKind::DigitalInput)?,
            points(device, ChannelKind::DigitalOutput)?,
            points(device, ChannelKind::AnalogInput)?,
            points(device, ChannelKind::AnalogOutput)?,
        ];
        let program = Program::start(command, device.folder.clone()).map_err(|source| {
            DriverError::System {
                device: device.name.clone(),
                key: "command",
                value: "a thread for its lines".to_owned(),
                source,
            }
        })?;
        Ok(Self {
            program,
            timer: PeriodTimer::new(period),
            timeout,
            points,
            newest: None,
            refused: 0,
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let ticks = self.timer.wait(timeout)?;
        if let Some(values) = self.program.newest() {
            self.newest = Some(values);
        }
        self.refused = self.program.refused();
        let reason = match self.program.state() {
            ProgramState::Running => match &self.newest {
                None => {
                    // The host sends nothing to a lost device, and the program only answers: it is asked without outputs.
                    self.program.offer(|| self.frame(&Outputs::NONE));
                    return Err(LinkError::Lost { reason: STARTING });
                }
                Some(values) if values.age() > self.timeout => LATE,
                Some(_) => 0,
            },
            ProgramState::Ended => {
                self.newest = None;
                return Err(LinkError::Lost { reason: ENDED });
            }
        };
        *inputs = self.inputs(reason == LATE);
        let reason = match reason {
            0 if self.is_out_of_range(inputs) => RANGE,
            reason => reason,
        };
        Ok(Exchange {
            strategy: ControlMode::Position,
            commandable: true,
            startable: true,
            mirror: [0.0; JOINTS_MAX],
            ticks,
            period_ns: self.timer.period_ns(),
            quality_permille: if reason == LATE { 0 } else { 1000 },
            reason,
            late: self.program.late(),
            refused: self.refused,
        })
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        self.program.offer(|| self.frame(outputs));
        Ok(())
    }

    fn release(&mut self) {}

    fn diagnosis(&self) -> Option<std::sync::Arc<dyn LinkDiagnosis>> {
        Some(self.program.counters())
    }
}

impl Software {
    /// Converts the newest values; a value that the program did not give is unknown, as are all that are too old.
    fn inputs(&self, too_old: bool) -> Inputs {
        let mut inputs = Inputs::NONE;
        let Some(values) = &self.newest else {
            return inputs;
        };
        let [digital, _, analog, _] = &self.points;
        for (point, bit) in digital.iter().zip(0..) {
            if let Some(on) = values.digital(key(point)).filter(|_| !too_old) {
                inputs.digital |= u64::from(on) << bit;
                inputs.digital_known |= 1 << bit;
            }
        }
        for (point, place) in analog.iter().zip(&mut inputs.analog) {
            *place = match key(point) {
                AGE => values.age().as_secs_f64(),
                name => match values.analog(name).filter(|_| !too_old) {
                    Some(raw) => to_si(point, raw),
                    None => f64::NAN,
                },
            };
        }
        inputs
    }

    /// Returns true if the program gave an analog value that is unknown nevertheless.
    fn is_out_of_range(&self, inputs: &Inputs) -> bool {
        let [_, _, analog, _] = &self.points;
        let mut rows = analog.iter().zip(inputs.analog);
        let newest = self.newest.as_ref();
        let given = |point| newest.is_some_and(|values| values.analog(key(point)).is_some());
        rows.any(|(point, value)| value.is_nan() && given(point))
    }

    fn frame(&self, outputs: &Outputs) -> Frame {
        let [_, digital, _, analog] = &self.points;
        let mut frame = Frame::default();
        for (point, bit) in digital.iter().zip(0..) {
            let set = outputs.digital_set >> bit & 1 == 1;
            frame.push_digital(key(point), set.then_some(outputs.digital >> bit & 1 == 1));
        }
        for (point, value) in analog.iter().zip(outputs.analog) {
            let value = value.is_finite().then(|| to_raw(point, value));
            frame.push_analog(key(point), value);
        }
        frame
    }
}

/// The name by which the program knows a channel; checked when the driver was opened.
fn key(channel: &ChannelConfig) -> &str {
    channel.address.as_str().unwrap_or_default()
}

fn points(device: &DeviceConfig, kind: ChannelKind) -> Result<Vec<ChannelConfig>, DriverError> {
    let expected = "the name by which the program knows it, a text; each output its own, and `age` only as an analog input in s without scale";
    let wrong = |channel: &ChannelConfig, cause: String| {
        Err(channel_error(device, channel, cause, expected))
    };
    let mut found: Vec<ChannelConfig> = Vec::new();
    for channel in channels(device, kind).into_iter().take(ANALOG_MAX.max(64)) {
        let name = match channel.address.as_str() {
            Some(name) if !name.is_empty() => name,
            _ => return wrong(channel, format!("{} is no name", channel.address)),
        };
        let is_age = kind == ChannelKind::AnalogInput
            && channel.unit == rcc_core::unit::Unit::SECOND
            && (channel.scale, channel.offset) == (1.0, 0.0);
        if name == AGE && !is_age {
            return wrong(channel, "`age` is the age of the values".to_owned());
        }
        if let Some(other) = found.iter().find(|other| key(other) == name) {
            return wrong(
                channel,
                format!("'{name}' is already used by '{}'", other.name),
            );
        }
        found.push(channel.clone());
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
