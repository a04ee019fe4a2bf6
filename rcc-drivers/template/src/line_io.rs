//! The template: a driver for a small I/O box that answers lines of text over UDP. Copy it to write a driver, see
//! `docs/drivers.md`.
//! Run by the host's thread, which waits in [`Driver::receive`] only.
//!
//! Each period the driver sends `get N` and receives `is N d1=1 a1=0.25`, then it sends `set N d1=0 a1=0.5`. Every line
//! ends with `#` and the CRC-32 of the text before it. The box forgets its outputs when it receives `get 0`, and
//! ignores a `set` whose number is not greater than the last one.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkError, Outputs, PeriodTimer, Settings,
    channel_error, channels, to_raw, to_si,
};
use rcc_driver_kit::host::output_release::OutputRelease;
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{ChannelConfig, DeviceConfig};
use rcc_driver_kit::rcc_core::impedance::ControlMode;
use rcc_driver_kit::rcc_core::message::JOINTS_MAX;
use rcc_driver_kit::rcc_core::primitive::ChannelKind;

// 1. What can be wrong with the device, in words for users; a driver's numbers start at 100.

/// The socket failed.
pub const SOCKET: u32 = 100;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[(
    SOCKET,
    "the I/O box cannot be reached at settings.box: check its power and the cable",
)];

/// Longest line, bytes.
const LINE_MAX: usize = 1024;

// 2. The driver: the socket, the settings, and the state between two exchanges.

/// A channel and its number on the box.
#[derive(Clone, Debug)]
struct LineChannel {
    number: u64,
    config: ChannelConfig,
}

/// The driver.
#[derive(Debug)]
pub struct LineIo {
    socket: UdpSocket,
    timer: PeriodTimer,
    timeout: Duration,
    /// By kind: digital in, digital out, analog in, analog out; in order of their index.
    points: [Vec<LineChannel>; 4],
    /// Values of the outputs without a command.
    released: Outputs,
    /// Time of the last answer; after `silence_max` without one, the driver sends the released outputs itself.
    last_answer: Instant,
    silence_max: Duration,
    /// Number of the next `get`.
    number: u64,
    late: u64,
    refused: u64,
}

impl Driver for LineIo {
    // 3. Everything that can be checked without the device; each error names its key and the expected value.
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let mut settings = Settings::of(device);
        let address = settings.address("box", None)?;
        let period = settings.duration("period", Duration::from_millis(10))?;
        let timeout = settings.duration("timeout", Duration::from_millis(20))?;
        settings.finish()?;
        if device.robot.is_some() {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "the I/O box does not support robots: remove `robot`, or choose another driver",
            });
        }
        let system = |source| DriverError::System {
            device: device.name.clone(),
            key: "box",
            value: address.to_string(),
            source,
        };
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(system)?;
        socket.connect(address).map_err(system)?;
        Ok(Self {
            socket,
            timer: PeriodTimer::new(period),
            timeout,
            points: [
                points(device, ChannelKind::DigitalInput)?,
                points(device, ChannelKind::DigitalOutput)?,
                points(device, ChannelKind::AnalogInput)?,
                points(device, ChannelKind::AnalogOutput)?,
            ],
            released: *OutputRelease::new(device).values(),
            last_answer: Instant::now(),
            silence_max: Duration::from_nanos(device.command_timeout_ns).max(5 * period),
            number: 0,
            late: 0,
            refused: 0,
        })
    }

    // 4. One cycle of the device: wait for it, send the request, read the answer. No answer: `Silent`; a broken
    //   connection: `Lost`.
    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let ticks = self.timer.wait(timeout)?;
        self.send_line(&format!("get {}", self.number))?;
        self.number += 1;
        let read = self.receive_answer()?;
        let Some(read) = read.and_then(|values| self.inputs(&values)) else {
            self.late += 1;
            // The box may receive our lines although its answers are lost: the host does not answer a silent device, so
            // the safe values are sent here.
            if self.last_answer.elapsed() > self.silence_max {
                let released = self.released;
                self.send(&released)?;
            }
            return Err(LinkError::Silent);
        };
        self.last_answer = Instant::now();
        *inputs = read;
        Ok(Exchange {
            strategy: ControlMode::Position,
            commandable: true,
            startable: true,
            mirror: [0.0; JOINTS_MAX],
            ticks,
            period_ns: self.timer.period_ns(),
            quality_permille: 1000,
            reason: 0,
            late: self.late,
            refused: self.refused,
        })
    }

    // 5. The answer: the host's outputs in wire format. An output without a value is not mentioned.
    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let mut line = format!("set {}", self.number - 1);
        let [_, digital, _, analog] = &self.points;
        for (point, bit) in digital.iter().zip(0..) {
            if outputs.digital_set >> bit & 1 == 1 {
                push(&mut line, 'd', point.number, outputs.digital >> bit & 1);
            }
        }
        for (point, value) in analog.iter().zip(outputs.analog) {
            if value.is_finite() {
                push(&mut line, 'a', point.number, to_raw(&point.config, value));
            }
        }
        self.send_line(&line)
    }

    // 6. Plain I/O has no command mode to leave.
    fn release(&mut self) {}
}

impl LineIo {
    fn send_line(&self, line: &str) -> Result<(), LinkError> {
        match self.socket.send(seal(line).as_bytes()) {
            Ok(_) => Ok(()),
            Err(error) => Err(lost(&error)),
        }
    }

    /// Returns the values of the answer to the last request, or `None` if it did not arrive. All other lines are
    /// refused.
    fn receive_answer(&mut self) -> Result<Option<BTreeMap<String, f64>>, LinkError> {
        let deadline = Instant::now() + self.timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let mut bytes = [0; LINE_MAX];
            let received = self
                .socket
                .set_read_timeout(Some(left))
                .and_then(|()| self.socket.recv(&mut bytes));
            match received {
                Ok(size) => match self.answer(bytes.get(..size).unwrap_or_default()) {
                    Some(values) => return Ok(Some(values)),
                    None => self.refused += 1,
                },
                Err(error) if is_pause(&error) => return Ok(None),
                Err(error) => return Err(lost(&error)),
            }
        }
    }

    fn answer(&self, bytes: &[u8]) -> Option<BTreeMap<String, f64>> {
        let (word, number, values) = parse(unseal(bytes)?)?;
        (word == "is" && number + 1 == self.number).then_some(values)
    }

    /// Returns the inputs of a complete answer.
    fn inputs(&self, values: &BTreeMap<String, f64>) -> Option<Inputs> {
        let mut inputs = Inputs::NONE;
        let [digital, _, analog, _] = &self.points;
        for (point, bit) in digital.iter().zip(0..) {
            let on = *values.get(&format!("d{}", point.number))? != 0.0;
            inputs.digital |= u64::from(on) << bit;
            inputs.digital_known |= 1 << bit;
        }
        for (point, place) in analog.iter().zip(&mut inputs.analog) {
            *place = to_si(&point.config, *values.get(&format!("a{}", point.number))?);
        }
        Some(inputs)
    }
}

// 7. Channels: the driver defines what an `address` means; an error names the channel and the expected value.

fn points(device: &DeviceConfig, kind: ChannelKind) -> Result<Vec<LineChannel>, DriverError> {
    let expected = "a number from 1 to 16 that no other channel of this kind has";
    let mut found: Vec<LineChannel> = Vec::new();
    for channel in channels(device, kind) {
        let number = channel
            .address
            .as_u64()
            .filter(|number| (1..=16).contains(number));
        let number = number.ok_or_else(|| {
            let cause = format!("the box has no channel {}", channel.address);
            channel_error(device, channel, cause, expected)
        })?;
        if let Some(other) = found.iter().find(|other| other.number == number) {
            let cause = format!("number {number} is already used by '{}'", other.config.name);
            return Err(channel_error(device, channel, cause, expected));
        }
        found.push(LineChannel {
            number,
            config: channel.clone(),
        });
    }
    Ok(found)
}

// 8. The wire format as pure functions: tested without a socket, and also used by the simulated box.

fn push(line: &mut String, kind: char, number: u64, value: impl std::fmt::Display) {
    // Writing to a String cannot fail.
    let _ = write!(line, " {kind}{number}={value}");
}

/// Appends the checksum to a line.
fn seal(line: &str) -> String {
    format!("{line}#{:08x}", crc32(line.as_bytes()))
}

/// Returns the line in these bytes, if its checksum is correct.
fn unseal(bytes: &[u8]) -> Option<&str> {
    let (line, check) = std::str::from_utf8(bytes).ok()?.rsplit_once('#')?;
    (check == format!("{:08x}", crc32(line.as_bytes()))).then_some(line)
}

/// Returns word, number and values of a line; every value is finite.
fn parse(line: &str) -> Option<(&str, u64, BTreeMap<String, f64>)> {
    let mut words = line.split(' ');
    let (word, number) = (words.next()?, words.next()?.parse().ok()?);
    let values = words.map(|pair| {
        let (name, value) = pair.split_once('=')?;
        let value = value
            .parse::<f64>()
            .ok()
            .filter(|value| value.is_finite())?;
        Some((name.to_owned(), value))
    });
    Some((word, number, values.collect::<Option<_>>()?))
}

/// CRC-32 as in IEEE 802.3.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _: u32| (crc >> 1) ^ (0xedb8_8320 * (crc & 1));
    let byte = |crc: u32, byte: &u8| (0..8).fold(crc ^ u32::from(*byte), step);
    !bytes.iter().fold(!0, byte)
}

fn is_pause(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

fn lost(error: &io::Error) -> LinkError {
    rcc_driver_kit::tracing::debug!(%error, "the socket failed");
    LinkError::Lost { reason: SOCKET }
}

// 9. The tests: the conformance suite, and the details of this wire.

#[cfg(test)]
mod conforms;
