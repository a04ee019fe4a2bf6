//! A driver for a small I/O box that answers lines of text over UDP.
//! Run by the host's thread, which waits in [`Driver::receive`] only.
//!
//! Each period the driver sends `get N` and receives `is N d1=1 a1=0.25`, then it sends `set N d1=0 a1=0.5`. The box forgets its outputs when it receives `get 0`, and
//! ignores a `set` whose number is not greater than the last one.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkError, Outputs, PeriodTimer, Settings,
};
use rcc_driver_kit::host::output_release::OutputRelease;
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::DeviceConfig;
use rcc_driver_kit::rcc_core::impedance::ControlMode;
use rcc_driver_kit::rcc_core::message::JOINTS_MAX;

use crate::text_line::{LINE_MAX, LineChannels, is_pause, parse, seal, unseal};

// 1. What can be wrong with the device, in words for users; a driver's numbers start at 100.

/// The socket failed.
pub const SOCKET: u32 = 100;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[(
    SOCKET,
    "the I/O box cannot be reached at settings.box: check its power and the cable",
)];

// 2. The driver: the socket, the settings, and the state between two exchanges.

/// The driver.
#[derive(Debug)]
pub struct LineIo {
    socket: UdpSocket,
    timer: PeriodTimer,
    timeout: Duration,
    channels: LineChannels,
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
            channels: LineChannels::of(device)?,
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
        let Some(read) = read.and_then(|values| self.channels.inputs(&values)) else {
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
        self.channels.push_outputs(&mut line, outputs);
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
}

fn lost(error: &io::Error) -> LinkError {
    rcc_driver_kit::tracing::debug!(%error, "the socket failed");
    LinkError::Lost { reason: SOCKET }
}

// 7. The tests: the conformance suite.

#[cfg(test)]
mod conforms;
