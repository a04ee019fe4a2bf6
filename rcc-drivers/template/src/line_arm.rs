//! A driver for the controller of an arm that sends its state first and is answered with set-points.
//! Run by the host's thread, which waits in [`Driver::receive`] only.
//!
//! Each period the controller sends `is N go=1 q1=0.1 q2=-0.5 d1=1 a1=0.25`, and the driver answers
//! `set N q1=0.1 q2=-0.5 d1=0 a1=0.5`; `go=1`: the controller follows set-points. Until then, each answer repeats the
//! controller's own position. `stop=1` in an answer asks the controller to follow no longer.

use std::collections::BTreeMap;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use rcc_driver_kit::driver::{Driver, DriverError, Exchange, Inputs, LinkError, Outputs, Settings};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::DeviceConfig;
use rcc_driver_kit::rcc_core::impedance::ControlMode;
use rcc_driver_kit::rcc_core::message::{JOINTS_MAX, Joints};

use crate::text_line::{LINE_MAX, LineChannels, is_pause, parse, push, seal, unseal};

// 1. What can be wrong with the device, in words for users; a driver's numbers start at 100.

/// The socket failed.
pub const SOCKET: u32 = 100;
/// The controller does not follow set-points.
pub const HOLDING: u32 = 101;
/// The controller follows set-points that this driver did not begin.
pub const REJOINED: u32 = 102;
/// The driver is ending.
pub const RELEASED: u32 = 103;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        SOCKET,
        "the socket at settings.listen failed: see the driver's log",
    ),
    (
        HOLDING,
        "the controller holds the arm and follows no set-points: it begins when it is answered in time",
    ),
    (
        REJOINED,
        "the controller is in the middle of a motion that this driver did not begin: it gets no answer and brakes",
    ),
    (RELEASED, "the driver has released the arm and is ending"),
];

/// After this silence the controller may have been restarted: its next line may have any number.
const SILENCE_MAX: Duration = Duration::from_millis(200);
/// Most datagrams that are read at once.
const BURST_MAX: usize = 64;

// 2. The driver: the socket, the settings, and the state between two exchanges.

/// The driver.
#[derive(Debug)]
pub struct LineArm {
    socket: UdpSocket,
    joints: usize,
    period: Duration,
    channels: LineChannels,
    /// The controller that is answered.
    controller: Option<SocketAddr>,
    line: Option<ArmLine>,
    last_line: Instant,
    /// The controller was seen to hold the arm, and has been answered since: what it follows began here.
    began: bool,
    released: bool,
    refused: u64,
}

/// A line of text from the controller.
#[derive(Clone, Copy, Debug)]
struct ArmLine {
    number: u64,
    follows: bool,
    inputs: Inputs,
}

impl Driver for LineArm {
    // 3. Everything that can be checked without the device; each error names its key and the expected value.
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let mut settings = Settings::of(device);
        let listen = settings.address("listen", None)?;
        let period = settings.duration("period", Duration::from_millis(4))?;
        settings.finish()?;
        let Some(robot) = &device.robot else {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "line-arm moves an arm: name its file, for example `robot: robots/lwr4plus.yaml`",
            });
        };
        let system = |source| DriverError::System {
            device: device.name.clone(),
            key: "listen",
            value: listen.to_string(),
            source,
        };
        let channels = LineChannels::of(device)?;
        Ok(Self {
            socket: UdpSocket::bind(listen).map_err(system)?,
            joints: robot.joints.len(),
            period,
            channels,
            controller: None,
            line: None,
            last_line: Instant::now(),
            began: false,
            released: false,
            refused: 0,
        })
    }

    // 4. One cycle of the device: wait for its line; after a stall of this process only the newest one counts.
    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let before = self.line.map(|line| line.number);
        let line = self.newest_line(timeout)?;
        // The device's own counter is the clock by which set-points are played.
        let ticks = before.map_or(1, |before| line.number.saturating_sub(before).max(1));
        self.began |= !line.follows;
        *inputs = line.inputs;
        let reason = self.reason(&line);
        Ok(Exchange {
            strategy: ControlMode::Position,
            commandable: reason == 0,
            startable: reason == 0,
            mirror: line.inputs.position,
            ticks,
            period_ns: u64::try_from(self.period.as_nanos()).unwrap_or(u64::MAX),
            quality_permille: 1000,
            reason,
            late: 0,
            refused: self.refused,
        })
    }

    // 5. The answer. In the middle of a motion that this driver did not begin, any position would be a jolt: without an
    //   answer the controller brakes by its own ramp.
    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let (Some(line), Some(controller)) = (&self.line, self.controller) else {
            return Ok(());
        };
        let reason = self.reason(line);
        if reason == REJOINED {
            return Ok(());
        }
        let position = match reason {
            0 => outputs.position,
            _ => line.inputs.position,
        };
        let mut text = format!("set {}", line.number);
        for (position, joint) in position.iter().zip(1..).take(self.joints) {
            push(&mut text, 'q', joint, position);
        }
        if self.released {
            text += " stop=1";
        }
        self.channels.push_outputs(&mut text, outputs);
        match self.socket.send_to(seal(&text).as_bytes(), controller) {
            Ok(_) => Ok(()),
            Err(error) => Err(lost(&error)),
        }
    }

    // 6. The arm is at rest: the controller is asked to follow no longer.
    fn release(&mut self) {
        self.released = true;
    }
}

impl LineArm {
    fn reason(&self, line: &ArmLine) -> u32 {
        match () {
            () if self.released => RELEASED,
            () if !line.follows => HOLDING,
            () if !self.began => REJOINED,
            () => 0,
        }
    }

    /// Waits for a line, and reads what has arrived besides.
    fn newest_line(&mut self, timeout: Duration) -> Result<ArmLine, LinkError> {
        let deadline = Instant::now() + timeout;
        let mut newest = None;
        for _ in 0..BURST_MAX {
            let left = deadline.saturating_duration_since(Instant::now());
            // A line that arrived during a stall is there already: it is read without waiting.
            let wait = (newest.is_none() && !left.is_zero()).then_some(left);
            match self.receive_line(wait) {
                Ok(Some(line)) => newest = Some(line),
                Ok(None) => self.refused += 1,
                Err(error) if is_pause(&error) => break,
                Err(error) => return Err(lost(&error)),
            }
        }
        if newest.is_some() {
            self.last_line = Instant::now();
        } else if self.last_line.elapsed() > SILENCE_MAX {
            (self.controller, self.line, self.began) = (None, None, false);
        }
        newest.ok_or(LinkError::Silent)
    }

    /// Receives one datagram; `Ok(None)`: it is not the next line of the controller.
    fn receive_line(&mut self, wait: Option<Duration>) -> io::Result<Option<ArmLine>> {
        self.socket.set_nonblocking(wait.is_none())?;
        if wait.is_some() {
            self.socket.set_read_timeout(wait)?;
        }
        let mut bytes = [0; LINE_MAX];
        let (size, from) = self.socket.recv_from(&mut bytes)?;
        if self.controller.is_some_and(|controller| controller != from) {
            return Ok(None);
        }
        let line = bytes.get(..size).and_then(|bytes| self.read(bytes));
        let last = self.line.map_or(0, |line| line.number);
        let line = line.filter(|line| line.number > last);
        if line.is_some() {
            (self.controller, self.line) = (Some(from), line);
        }
        Ok(line)
    }

    fn read(&self, bytes: &[u8]) -> Option<ArmLine> {
        let (word, number, values) = parse(unseal(bytes)?)?;
        let follows = *values.get("go")? != 0.0;
        let inputs = Inputs {
            position: self.position(&values)?,
            torque: [f64::NAN; JOINTS_MAX],
            external_torque: [f64::NAN; JOINTS_MAX],
            ..self.channels.inputs(&values)?
        };
        (word == "is").then_some(ArmLine {
            number,
            follows,
            inputs,
        })
    }

    fn position(&self, values: &BTreeMap<String, f64>) -> Option<Joints> {
        let mut position = [0.0; JOINTS_MAX];
        for (place, joint) in position.iter_mut().zip(1..).take(self.joints) {
            *place = *values.get(&format!("q{joint}"))?;
        }
        Some(position)
    }
}

fn lost(error: &io::Error) -> LinkError {
    rcc_driver_kit::tracing::debug!(%error, "the socket failed");
    LinkError::Lost { reason: SOCKET }
}

// 7. The tests: the conformance suite.

#[cfg(test)]
mod conforms;
